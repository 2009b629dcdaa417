from eclsim.outputs.registry import all_outputs


def test_every_output_is_listed_with_what_a_case_needs(shell):
    text = shell.run("outputs").stdout
    shown = [line.split()[0] for line in text.splitlines() if line and not line.startswith(("In ", "With "))]
    assert sorted(shown[1:]) == sorted(all_outputs())
    assert "\nWith [ecmo] and [gas]\nSpreO2 " in text


def test_one_is_explained_with_its_limits_and_a_misspelt_one_corrected(shell):
    text = shell.run("outputs", "lowest_drainage_pressure").stdout
    assert "minimum of Pecmodrain" in text
    assert "  needs       [ecmo]\n" in text
    assert "  warning     below -100 mmHg: suction" in text
    assert "a key of [measurements]" in shell.run("outputs", "SvO2").stdout
    refused = shell.run("outputs", "SVO2")
    assert refused.exit_code == 2
    assert "did you mean SvO2" in refused.stderr

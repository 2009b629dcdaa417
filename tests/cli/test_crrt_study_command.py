import pytest


def run(shell, case, *arguments):
    return shell.run("crrt-study", case, *arguments)


def test_all_wrong_options_are_told_at_once_and_nothing_is_computed(shell):
    case = shell.case(more=shell.ecmo)
    result = run(shell, case, "--schemes", "a,q", "--speeds", "fast", "--crrt-flow", "-5")
    assert result.exit_code == 2
    message = result.stderr
    assert "--schemes 'q' is not a scheme" in message
    assert "--speeds 'fast' are not speeds" in message
    assert "--crrt-flow: CRRT flow -5 mL/min" in message


@pytest.mark.parametrize(
    ("more", "text"),
    [
        ("", "no [ecmo] section"),
        ('[ecmo]\npump = {roller_l_min = 4.0}\noxygenator = "Quadrox-i Adult"\nmode = "VA"\n', "roller pump"),
    ],
)
def test_a_case_without_a_rotary_pump_is_refused(shell, more, text):
    result = run(shell, shell.case(more=more))
    assert result.exit_code == 2
    assert text in result.stderr


def test_results_that_stand_are_kept_without_force(shell):
    case = shell.case(more=shell.ecmo)
    folder = shell.folder / "out"
    folder.mkdir()
    (folder / "report.html").write_text("mine")
    result = run(shell, case, "--out", folder)
    assert result.exit_code == 2
    assert "--force" in result.stderr
    assert (folder / "report.html").read_text() == "mine"


@pytest.mark.parametrize("wrong", ["file", "missing/out"])
def test_a_folder_that_cannot_be_written_is_named_with_its_own_option(shell, wrong):
    case = shell.case(more=shell.ecmo)
    (shell.folder / "file").write_text("mine")
    result = run(shell, case, "--out", shell.folder / wrong)
    assert result.exit_code == 2
    assert f"--out {shell.folder / wrong}: " in result.stderr
    assert "--figures" not in result.stderr


def test_beats_that_are_not_found_are_named_and_the_exit_status_says_so(shell):
    """A left heart so weak that no valve opens at 6200 rpm, with or without CRRT."""
    import json

    from eclsim.cases.reading import write_case
    from eclsim.paper.crrt import paper_case

    case = shell.folder / "weak.toml"
    write_case(paper_case(), case)
    result = run(
        shell, case, "--schemes", "d,g", "--speeds", "3000,6200", "--volume-policy", "as_published",
        "--set", "parameters.Emaxlv=1.0", "--json", "-",
    )  # fmt: skip
    assert result.exit_code == 1
    assert "no steady beat at 6200 rpm (valves stay shut, so that the volumes" in result.stderr
    found = json.loads(result.stdout)
    assert not found["converged"]
    assert {one["status"] for one in found["not_known"]} == {"one_of_many"}
    limits = found["policies"]["as_published"]["limits"]["schemes"]["d"]["suction"]
    assert not limits["kept_throughout"]


def test_reproduce_keeps_results_that_stand(shell):
    folder = shell.folder / "paper"
    folder.mkdir()
    (folder / "reproduction.csv").write_text("mine")
    for arguments in ((folder,), ("--out", folder)):
        result = shell.run("reproduce", *arguments)
        assert result.exit_code == 2
        assert "--force" in result.stderr


@pytest.mark.parametrize(
    ("arguments", "text"),
    [((), "no output folder"), (("paper", "--out", "other"), "two folders; give only one")],
)
def test_reproduce_needs_one_folder(shell, arguments, text):
    result = shell.run("reproduce", *arguments)
    assert result.exit_code == 2
    assert text in result.stderr


def test_the_whole_command_writes_json_to_standard_output_alone(shell):
    import json

    case = shell.case(more=shell.ecmo)
    result = run(
        shell, case, "--schemes", "g", "--speeds", "3000", "--volume-policy", "as_published", "--json", "-"
    )
    assert result.exit_code == 0
    found = json.loads(result.stdout)
    assert list(found["policies"]) == ["as_published"]
    assert list(found["policies"]["as_published"]["schemes"]) == ["g"]


def test_reproduce_tells_all_wrong_options_at_once(shell):
    result = shell.run("reproduce", shell.folder / "paper", "--parts", "cohrt", "--samples", "100")
    assert result.exit_code == 2
    assert "did you mean cohort?" in result.stderr
    assert "--samples 100: allowed: a power of two" in result.stderr
    assert not (shell.folder / "paper").exists()


def test_reproduce_refuses_a_cohort_that_cannot_be_read(shell):
    table = shell.folder / "cohort.csv"
    table.write_text("patient_id,SP\nP01,100\n")
    result = shell.run("reproduce", shell.folder / "paper", "--cohort", table)
    assert result.exit_code == 2
    assert "missing" in result.stderr


def test_a_cohort_is_checked_before_anything_is_computed(shell):
    table = shell.folder / "cohort.csv"
    table.write_text("patient_id,SP\nP01,100\n")
    result = shell.run("crrt-study", table, "--set", "ecmo.speed_rpm=3000", "--schemes", "q", "--resume")
    assert result.exit_code == 2
    for message in (
        "--set: works for one case file only",
        "--schemes 'q' is not a scheme",
        "--resume and --shard need --out DIR",
    ):
        assert message in result.stderr
    result = shell.run("crrt-study", table)
    assert result.exit_code == 2
    assert "missing" in result.stderr


def test_a_folder_of_cases_is_a_cohort(shell):
    folder = shell.folder / "cases"
    folder.mkdir()
    assert "holds no case file" in shell.run("crrt-study", folder).stderr
    shell.case("cases/one.toml", more=shell.ecmo)
    assert f"{folder} holds some" in shell.run("crrt-study", shell.folder).stderr
    options = ("--schemes", "g,h", "--speeds", "3000", "--volume-policy", "as_published")
    result = shell.run("crrt-study", folder, *options, "--out", shell.folder / "out")
    assert result.exit_code == 0, result.stderr
    assert "is first in all 1 data points" in result.stdout
    assert (shell.folder / "out" / "report.html").exists()
    assert "--force" in shell.run("crrt-study", folder, *options, "--out", shell.folder / "out").stderr


@pytest.mark.slow
def test_a_case_whose_flow_no_speed_gives_is_named_and_the_others_are_studied(shell):
    """One such case file among many, and none was studied."""
    import json

    (shell.folder / "cases").mkdir()
    shell.case("cases/one.toml", more=shell.ecmo)
    flow = shell.ecmo.replace("speed_rpm = 3425", "flow_l_min = 9.5")
    shell.case("cases/two.toml", "P02", more=flow)
    options = ("--schemes", "g,h", "--speeds", "3000", "--volume-policy", "as_published", "--json")
    result = shell.run("crrt-study", shell.folder / "cases", *options, shell.folder / "out.json")
    assert result.exit_code == 1
    assert "is first in all 1 data points" in result.stdout
    reason = "ecmo.flow_l_min = 9.5 cannot be reached: the highest flow reached is "
    assert f"P02: {reason}" in result.stderr
    assert json.loads((shell.folder / "out.json").read_text())["lost"]["P02"].startswith(reason)
    assert shell.run("crrt-study", shell.folder / "cases" / "two.toml", *options, "-").exit_code == 2


def test_a_flow_in_l_min_is_refused_as_in_a_case_file(shell):
    result = run(shell, shell.case(more=shell.ecmo), "--crrt-flow", "0.2")
    assert result.exit_code == 2
    assert "--crrt-flow: CRRT flow 0.2 mL/min; allowed: 10 to 600; did you mean 0.2 L/min" in result.stderr

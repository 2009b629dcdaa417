from eclsim.spelling import did_you_mean, nearest

KEYS = ("MAP", "MPAP", "PCWP", "age_years", "speed_rpm")


def test_nearest_spellings_best_first():
    assert nearest("map", KEYS) == ("MAP",)
    assert nearest("MAPP", KEYS)[0] == "MAP"
    assert nearest("age", KEYS) == ("age_years",)
    assert nearest("zzz", KEYS) == ()
    assert nearest("x" * 100_000, KEYS) == ()


def test_in_words():
    assert did_you_mean("sped_rpm", KEYS) == "speed_rpm"
    assert did_you_mean("zzz", KEYS) == ""


def test_other_names_of_drugs_and_fluids_lead_to_those_that_there_are():
    """Saline was taken for albumin and phenylephrine for milrinone."""
    drugs, fluids = ("noradrenaline", "adrenaline", "milrinone"), ("albumin_ml", "crystalloid_ml")
    assert nearest("norepinephrine", drugs) == ("noradrenaline",)
    assert nearest("drugs.epinephrine", [f"drugs.{one}" for one in drugs]) == ("drugs.adrenaline",)
    assert nearest("norepi", drugs) == ("noradrenaline",)
    assert nearest("hb", ("haemoglobin_g_dl", "fio2")) == ("haemoglobin_g_dl",)
    assert nearest("saline_ml", fluids) == ("crystalloid_ml",)
    assert nearest("phenylephrine", drugs) == nearest("plasma_ml", fluids) == ()

"""`eclsim course` and `eclsim plan` as a user runs them."""

import json

EVENTS = "[[events]]\nat_min = 2\ngive = { blood_ml = 100 }\nover_min = 4\n"


def test_a_course_is_written_as_table_netcdf_and_json(shell):
    case, folder = shell.case(more=EVENTS), shell.folder / "out"
    figures = shell.folder / "figures"
    arguments = ("course", case, "--until", "10", "--every", "5", "--out", folder, "--figures", figures)
    done = shell.run(*arguments, "--json", "-")
    assert done.exit_code == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["time_min"] == [0.0, 2.0, 5.0, 6.0, 10.0]
    assert abs(found["balance"]["given_ml"] - 100.0) < 1e-6
    assert abs(found["balance"]["error_ml"]) < 1e-6
    assert sorted(path.name for path in folder.iterdir()) == ["P01_course.csv", "P01_course.nc"]
    assert "time_min [min]" in (folder / "P01_course.csv").read_text().splitlines()[0]
    again = shell.run(*arguments)
    assert (again.exit_code, "P01_course.csv already; --force overwrites" in again.stderr) == (2, True)
    drawn = shell.run("course", case, "--figures", figures)
    assert (drawn.exit_code, "P01_course" in drawn.stderr) == (2, True)


def test_what_cannot_be_meant_is_said_before_anything_is_computed(shell):
    case = shell.case(more=EVENTS)
    for arguments, said in (
        (("course", case), "--out DIR, --json FILE or --figures DIR"),
        (("course", case, "--until", "1.5", "--json", "-"), "after the end of the course at 1.5 min"),
        (("course", case, "--beats", "--json", "-"), "--beats: 1440 min; allowed: up to 120 min"),
        (("course", case, "--every", "0.01", "--json", "-"), "144000 moments; allowed: up to 20000"),
        (("plan", case), "--remove-ml or --wean: give one of them"),
        (("plan", case, "--remove-ml", "500"), "--remove-ml needs --keep"),
        (("plan", case, "--remove-ml", "500", "--keep", "MAPP > 60"), "did you mean MAP"),
        (("plan", case, "--remove-ml", "500", "--keep", "MAP > 60"), "no device that removes fluid"),
        (("plan", case, "--wean", "3000"), "no ECMO to wean from"),
    ):
        done = shell.run(*arguments)
        assert done.exit_code == 2, arguments
        assert said in done.stderr, done.stderr

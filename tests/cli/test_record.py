"""One folder of results, one command: recorded in it, and recognised by its files without a record."""

import json

import pytest

from eclsim.cli.application import _DISTRIBUTED
from eclsim.cli.record import _FILES_OF, COMMAND, recorded, refuse_results_of_others

OPTIONS = {"json": None, "workers": None, "dask": None, "shard": None, "resume": False, "force": False}
FILES = [(command, files) for command, sets in _FILES_OF.items() for files in sets]


def options_for(folder, **changed):
    from eclsim.cli.validate import ValidateOptions

    return ValidateOptions(**{**OPTIONS, "out": str(folder), **changed})


@pytest.mark.parametrize(
    "chosen", [("--resume",), ("--force",), ("--shard", "1/2")], ids=lambda chosen: chosen[0]
)
@pytest.mark.parametrize("command", ["sensitivity", "track"])
def test_a_folder_of_another_command_is_refused_by_name(shell, command, chosen):
    """Their results were mixed without a word, and a shard was told that its seed had changed."""
    out = shell.folder / "out"
    out.mkdir()
    for name in ("identification.json", "parameters.csv"):
        (out / name).touch()
    done = shell.run(command, shell.case(), "--out", out, *chosen)
    assert done.exit_code == 2
    assert done.stderr == (
        f"error: --out {out}: holds results of eclsim identify; choose another folder for those of this "
        "command\n"
    )
    assert {item.name for item in out.iterdir()} == {"identification.json", "parameters.csv"}


def test_a_shard_in_a_folder_of_shards_of_another_command_is_told_so(tmp_path, capsys):
    (tmp_path / COMMAND).write_text(
        json.dumps({"command": "identify", "options": {"only": ["x"]}, "shards": 2})
    )
    with pytest.raises(SystemExit), recorded(options_for(tmp_path, shard="1/2"), "validate"):
        pass
    assert "holds results of eclsim identify" in capsys.readouterr().err


def test_every_command_of_many_tasks_is_recognised_by_its_files():
    assert {function.__name__ for function in _DISTRIBUTED} == set(_FILES_OF)


@pytest.mark.parametrize(("command", "files"), FILES, ids=lambda value: str(value))
def test_results_without_a_record_are_those_of_the_files(tmp_path, capsys, command, files):
    for name in files:
        path = tmp_path / name.replace("*", "P01")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    refuse_results_of_others(tmp_path, command)
    other = next(name for name in _FILES_OF if name != command)
    with pytest.raises(SystemExit):
        refuse_results_of_others(tmp_path, other)
    assert f"holds results of eclsim {command.replace('_', '-')};" in capsys.readouterr().err


def test_the_record_is_there_while_the_command_runs_and_stays_with_results(tmp_path):
    with recorded(options_for(tmp_path), "validate"):
        assert json.loads((tmp_path / COMMAND).read_text())["command"] == "validate"
        (tmp_path / "result").touch()
    assert (tmp_path / COMMAND).exists()
    with pytest.raises(SystemExit), recorded(options_for(tmp_path), "identify"):
        pytest.fail("the command would run")


@pytest.mark.parametrize("ending", [None, SystemExit(2), KeyboardInterrupt()])
def test_a_command_that_stored_nothing_leaves_no_record(tmp_path, ending):
    (tmp_path / "notes of the user.txt").touch()
    if ending is None:
        with recorded(options_for(tmp_path), "validate"):
            pass
    else:
        with pytest.raises(type(ending)), recorded(options_for(tmp_path), "validate"):
            raise ending
    assert not (tmp_path / COMMAND).exists()


def test_a_file_of_the_user_with_the_name_of_the_record_is_kept(tmp_path):
    (tmp_path / COMMAND).write_text("{")
    with recorded(options_for(tmp_path), "validate"):
        (tmp_path / "result").touch()
    assert (tmp_path / COMMAND).read_text() == "{"


@pytest.mark.parametrize("name", ["missing/out", "a" * 300, "nul\0", "file"])
def test_a_folder_that_cannot_be_is_left_to_the_command(tmp_path, name):
    (tmp_path / "file").touch()
    with recorded(options_for(tmp_path / name), "validate"):
        pass
    assert [item.name for item in tmp_path.iterdir()] == ["file"]

"""The documentation's examples run, and its links lead somewhere."""

import itertools
import re
import shlex
import shutil
from pathlib import Path

import pytest

from eclsim.devices.registry import devices, forget_device

REPOSITORY = Path(__file__).parents[1]
PAGES = [REPOSITORY / "README.md", *sorted((REPOSITORY / "docs").rglob("*.md"))]
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)
SNIPPET = re.compile(r'^--8<-- "(.*)"$', re.MULTILINE)
LINK = re.compile(r"\]\((?!https?://|mailto:|#)([^)#\s]+)[^)]*\)")


def name(page: Path) -> str:
    return page.relative_to(REPOSITORY).as_posix()


@pytest.mark.slow
@pytest.mark.parametrize("page", [p for p in PAGES if BLOCK.search(p.read_text(encoding="utf-8"))], ids=name)
def test_python_examples_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    for case in (REPOSITORY / "examples").glob("*.toml"):
        shutil.copy(case, tmp_path)
    code = "\n".join(BLOCK.findall(SNIPPET.sub(included, page.read_text(encoding="utf-8"))))
    before = set(devices())
    try:
        exec(compile(code, str(page), "exec"), {"__name__": "example"})
    finally:
        for key in set(devices()) - before:
            forget_device(key)


def included(snippet: re.Match[str]) -> str:
    return (REPOSITORY / snippet[1]).read_text(encoding="utf-8")


@pytest.mark.parametrize("page", [*PAGES, REPOSITORY / "CONTRIBUTING.md"], ids=name)
def test_relative_links_lead_to_files(page: Path):
    links = LINK.findall(page.read_text(encoding="utf-8"))
    assert [link for link in links if not (page.parent / link).exists()] == []


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_every_row_of_a_table_stands_in_one(page: Path):
    """A blank line within a table makes text of the rows below it."""
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    blocks = re.findall(r"(?:^\|.*\n?)+", text, re.MULTILINE)
    assert [block for block in blocks if not re.match(r".*\n\|[\s:|-]+\|(?:\n|$)", block)] == []


def prose_of(page: Path) -> list[str]:
    """Lines of a page, those of code blocks and comments left empty."""
    text = page.read_text(encoding="utf-8")
    for pattern in (r"^```.*?^```", r"<!--.*?-->"):
        text = re.sub(
            pattern, lambda found: "\n" * found[0].count("\n"), text, flags=re.MULTILINE | re.DOTALL
        )
    return ["", *text.splitlines(), ""]


@pytest.mark.parametrize("page", [*PAGES, REPOSITORY / "CONTRIBUTING.md"], ids=name)
def test_tables_lists_and_formulae_stand_apart_from_the_text(page: Path):
    """Glued to a paragraph they are read as part of it, and the page shows bars, dashes and dollars."""
    item, wrong = re.compile(r"- |\d+\. "), []
    pairs = itertools.pairwise(prose_of(page))
    for number, (before, line) in enumerate(pairs, 1):
        text_before = bool(before) and not before.startswith(("|", " ", "- ", ":", "[", "$$", "!!!"))
        glued_table = line.startswith("|") and bool(before) and not before.startswith("|")
        glued_text = before.startswith("|") and bool(line) and not line.startswith("|")
        glued_item = bool(item.match(line)) and text_before and not item.match(before)
        ends = re.search(r"\$\$(?!\S?$)", line[2:]) if line.startswith("$$") else re.search(r"\$\$.", line)
        if glued_table or glued_text or glued_item or ends:
            wrong.append(f"{number}: {line[:60]}")
    assert wrong == []


def commands_of(page: str) -> list[str]:
    """What the page tells the reader to type, comments left out, in its order; simulations alone."""
    shell = "\n".join(re.findall(r"^```sh\n(.*?)^```$", page, re.MULTILINE | re.DOTALL))
    lines = [line.partition("#")[0].strip() for line in shell.splitlines()]
    lines += re.findall(r"^\|[^|]*\| `(eclsim [^`]*)`", page, re.MULTILINE)
    return [line for line in lines if line.startswith("eclsim simulate ")]


def typed(page: str) -> list[str]:
    """Every command line that a page tells the reader to type, comments left out."""
    blocks = re.findall(r"^```(?:sh|console|bash)?\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    blocks += re.findall(r"^((?:    eclsim (?!is ).*\n)+)", page, re.MULTILINE)
    joined = "\n".join(blocks).replace("\\\n", " ")
    lines = [line.partition(" #")[0].strip().removeprefix(".venv/bin/") for line in joined.splitlines()]
    return [line for line in lines if line.startswith("eclsim ")]


@pytest.mark.parametrize("page", [p for p in PAGES if typed(p.read_text(encoding="utf-8"))], ids=name)
def test_every_command_of_the_pages_has_the_options_that_it_is_typed_with(page: Path):
    from typer.testing import CliRunner

    from eclsim.cli.application import app

    for line in typed(page.read_text(encoding="utf-8")):
        text = shlex.split(re.sub(r"--device \S+", "", line))[1:]
        done = CliRunner().invoke(app, [*text, "--help"])  # options are read before help is given
        assert done.exit_code == 0, f"{line}\n{done.stderr}"


@pytest.mark.slow
def test_the_commands_of_getting_started_work_one_after_the_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    from typer.testing import CliRunner

    from eclsim.cli.application import app

    page = (REPOSITORY / "docs" / "getting-started.md").read_text(encoding="utf-8")
    case, own_patient = re.findall(r"^```toml\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    (shown,) = re.findall(r"^```text\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    monkeypatch.chdir(tmp_path)
    Path("patient.toml").write_text(case, encoding="utf-8")
    Path("my_patient.toml").write_text(own_patient, encoding="utf-8")
    commands = commands_of(page)
    assert len(commands) >= 8
    assert any("--sweep" in command for command in commands)
    outputs = []
    for command in commands:
        done = CliRunner().invoke(app, shlex.split(command)[1:], catch_exceptions=False)
        assert done.exit_code == 0, f"{command}\n{done.stderr}"
        outputs.append(" ".join((done.stderr + done.stdout).split()))
    for line in shown.splitlines():
        assert " ".join(line.split()) in outputs[0] or line == "...", line
    assert Path("figures", "first_circuit.png").exists()

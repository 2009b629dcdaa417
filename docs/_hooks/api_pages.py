"""Adds a page of the public names and one for each room of the package; new ones appear by themselves."""

import ast
import inspect
from importlib import import_module
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

from eclsim.front_door import public_names

PACKAGE = Path(__file__).parents[2] / "src" / "eclsim"
COMMAND_LINE = {"cli", "app"}  # described by what users see of them


def rooms() -> dict[str, str]:
    """Public modules and packages with the first line of their docstring."""
    found = {}
    for path in sorted(PACKAGE.iterdir()):
        source = path / "__init__.py" if path.is_dir() else path
        if (
            path.stem.startswith("_")
            or path.stem in COMMAND_LINE
            or source.suffix != ".py"
            or not source.exists()
        ):
            continue
        docstring = ast.get_docstring(ast.parse(source.read_text(encoding="utf-8"))) or ""
        found[path.stem] = docstring.partition("\n")[0]
    return found


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Put the pages behind the overview in the navigation."""
    pages = [{f"eclsim.{room}": f"api/{room}.md"} for room in rooms()]
    config.nav[-1] = {"API": ["api/index.md", {"eclsim": "api/eclsim.md"}, *pages]}
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Write the pages."""
    rows = [
        f"| [`eclsim.{name}`][{module}.{name}] | {_summary(module, name)} |"
        for name, module in sorted(public_names().items(), key=_order)
    ]
    table = "\n".join(["| name | |", "|---|---|", *rows])
    text = f"# eclsim\n\nWhat `import eclsim` gives: functions first, then classes.\n\n{table}\n"
    files.append(File.generated(config, "api/eclsim.md", content=text))
    for room in rooms():
        text = f"# eclsim.{room}\n\n::: eclsim.{room}\n    options:\n      show_root_heading: false\n"
        files.append(File.generated(config, f"api/{room}.md", content=text))
    return files


def _summary(module: str, name: str) -> str:
    """First line of a public name's docstring."""
    return (inspect.getdoc(getattr(import_module(module), name)) or "").partition("\n")[0]


def _order(entry: tuple[str, str]) -> tuple[bool, str]:
    """Functions before classes, each by name."""
    return entry[0][0].isupper(), entry[0]


def on_page_markdown(markdown: str, page, **_: object) -> str:
    """List the pages in the overview."""
    if page.file.src_uri != "api/index.md":
        return markdown
    public = "| [`eclsim`](eclsim.md) | What `import eclsim` gives. |"
    rows = [public, *(f"| [`eclsim.{room}`]({room}.md) | {words} |" for room, words in rooms().items())]
    return markdown + "\n".join(["", "| module | |", "|---|---|", *rows, ""])

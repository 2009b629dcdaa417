"""Adds one API page for each layer of the package, so that a new layer is documented by existing."""

import ast
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

PACKAGE = Path(__file__).parents[2] / "src" / "eclsim"
COMMAND_LINE = {"cli", "app"}  # described by what users see of them


def layers() -> dict[str, str]:
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
    pages = [{f"eclsim.{layer}": f"api/{layer}.md"} for layer in layers()]
    config.nav[-1] = {"API": ["api/index.md", *pages]}
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Write the pages."""
    for layer in layers():
        text = f"# eclsim.{layer}\n\n::: eclsim.{layer}\n    options:\n      show_root_heading: false\n"
        files.append(File.generated(config, f"api/{layer}.md", content=text))
    return files


def on_page_markdown(markdown: str, page, **_: object) -> str:
    """List the pages in the overview."""
    if page.file.src_uri != "api/index.md":
        return markdown
    rows = [f"| [`eclsim.{layer}`]({layer}.md) | {words} |" for layer, words in layers().items()]
    return markdown + "\n".join(["", "| module | |", "|---|---|", *rows, ""])

"""Fails the build if a page of the site would load anything from another server."""

import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError

LOADS = re.compile(
    r"""<(?:script|img|iframe|source|video|audio|embed)\b[^>]*\bsrc=["']?(?:https?:)?//[^"'\s>]+"""
    r"""|<link\b(?=[^>]*\brel=["']?(?:stylesheet|preload|preconnect|icon|dns-prefetch))[^>]*\bhref=["']?(?:https?:)?//[^"'\s>]+"""
    r"""|@import\s+(?:url\()?["']?(?:https?:)?//[^"'\s)]+|url\(["']?(?:https?:)?//[^"'\s)]+""",
    re.IGNORECASE,
)


def on_post_build(config: MkDocsConfig) -> None:
    """Search pages and style sheets for links that a browser follows by itself."""
    pages = [path for path in Path(config.site_dir).rglob("*") if path.suffix in {".html", ".css"}]
    found = [
        f"{path}: {hit[0]}" for path in pages for hit in LOADS.finditer(path.read_text(encoding="utf-8"))
    ]
    if found:
        raise PluginError("the site must work without other servers, but loads\n  " + "\n  ".join(found))

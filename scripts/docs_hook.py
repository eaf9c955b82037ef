"""Hooks of the documentation build: the README as its first page, and links out of `docs/`.

The pages are also read in the repository, where they link to code and examples. In the site each such
file or folder becomes a page that shows it.
"""

import posixpath
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
HOME = ROOT / "README.md"
LINK = re.compile(r"\]\((?!https?:|mailto:|#)([^)\s#]+)((?:#[^)\s]*)?)\)")
LANGUAGES = {".py": "python", ".c": "c", ".toml": "toml"}


def on_files(files: Files, config: Any) -> Files:
    """Add the first page, the list of decisions, and a page for everything outside `docs/` that is linked to."""
    files.append(File.generated(config, "index.md", content=HOME.read_text(encoding="utf-8")))
    files.append(File.generated(config, "decisions/index.md", content=_listing(DOCS / "decisions", "Decisions")))
    pages = [HOME, *DOCS.rglob("*.md")]
    texts = [(page, page.read_text(encoding="utf-8")) for page in pages]
    linked = {(page.parent / target).resolve() for page, text in texts for target, _ in LINK.findall(text)}
    for path in sorted(linked):
        if path.exists() and not path.is_relative_to(DOCS) and path != HOME:
            text = _listing(path, _name(path)) if path.is_dir() else _shown(path)
            files.append(File.generated(config, _uri(path), content=text))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Point every link to its page in the site."""
    uri = page.file.src_uri
    if uri.startswith("source/"):
        return markdown
    origin = ROOT if uri == "index.md" else (DOCS / uri).parent

    def lead(match: re.Match[str]) -> str:
        path = (origin / match.group(1)).resolve()
        if not path.is_relative_to(ROOT):
            return match.group(0)
        return f"]({posixpath.relpath(_uri(path), posixpath.dirname(uri) or '.')}{match.group(2)})"

    return LINK.sub(lead, markdown)


def _uri(path: Path) -> str:
    """The site's address for a file or folder of the repository."""
    if path == HOME:
        return "index.md"
    if path.is_relative_to(DOCS):
        return path.relative_to(DOCS).as_posix() + ("/index.md" if path.is_dir() else "")
    return f"source/{_name(path).replace('/', '-').removesuffix('.md')}.md"


def _name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def _listing(folder: Path, title: str) -> str:
    files = sorted(path for path in folder.iterdir() if path.suffix in {".md", *LANGUAGES} and path.name[0] != "_")
    if folder.is_relative_to(DOCS):
        titles = [(path, path.read_text(encoding="utf-8").splitlines()[0].removeprefix("# ")) for path in files]
        return f"# {title}\n\n" + "".join(f"- [{text}]({path.name})\n" for path, text in titles)
    return f"# {title}\n\n" + "\n".join(_block(path) for path in files)


def _shown(path: Path) -> str:
    text = path.read_text(encoding="utf-8")
    return LINK.sub("]", text) if path.suffix == ".md" else f"# {_name(path)}\n\n{_block(path)}"


def _block(path: Path) -> str:
    text = path.read_text(encoding="utf-8")
    return f'````{LANGUAGES.get(path.suffix, "")} title="{_name(path)}"\n{text}\n````\n'

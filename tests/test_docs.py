"""Documents against the project: links, anchors, commands, Python blocks."""

from __future__ import annotations

import ast
import re
import shlex
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from urllib.parse import unquote

import pytest
import typer.main
from typer.testing import CliRunner

import cartier
from cartier.cli import app
from cartier.pipeline import map_home
from synthetic import TrueBoxes, box, walk

ROOT = Path(__file__).parents[1]
DOCUMENTS = [
    str(p.relative_to(ROOT)) for p in (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").glob("*.md"))
]
FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
SPAN = re.compile(r"`([^`\n]+)`")
END_OF_COMMAND = ("&&", "||", "|", ";", "&", ">", "#")


def text_of(document: str) -> str:
    return (ROOT / document).read_text("utf-8")


def anchors(path: Path) -> set[str]:
    """The anchors that the headings of a document have where it is shown."""
    heads = re.findall(r"^#+ +(.+?) *$", FENCE.sub("", path.read_text("utf-8")), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.replace("`", "").lower()).replace(" ", "-") for head in heads}


def commands(document: str, first: str) -> Iterator[list[str]]:
    """The words of each command line of a document, in blocks and in spans of code, that runs ``first``."""
    text = text_of(document)
    lines = [line for _, block in FENCE.findall(text) for line in block.replace("\\\n", " ").splitlines()]
    for line in (*lines, *SPAN.findall(FENCE.sub("", text))):
        try:
            words = shlex.split(line.removeprefix("$ "), comments=True)
        except ValueError:  # an apostrophe in prose
            continue
        here: list[str] = []
        for word in (*words, ";"):
            if word not in END_OF_COMMAND:
                here.append(word)
                continue
            while here and re.fullmatch(r"\w+=\S*", here[0]):  # variables of the environment
                here = here[1:]
            if here[:1] == [first]:
                yield here[1:]
            here = []


@cache
def command_line() -> dict[str, set[str]]:
    """The options of each command of ``cartier``; those of a group are called "fleet map"."""
    found: dict[str, set[str]] = {}
    for name, command in typer.main.get_command(app).commands.items():  # type: ignore[attr-defined]
        within = getattr(command, "commands", {})
        for full, each in {name: command, **{f"{name} {part}": each for part, each in within.items()}}.items():
            options = (option for given in each.params for option in (*given.opts, *given.secondary_opts))
            found[full] = {"--help", *options}
    return found


def script_knows(script: Path, words: list[str]) -> bool:
    """Whether a script's parser is given the options of a command, and its subcommand if it has some."""
    nodes = list(ast.walk(ast.parse(script.read_text("utf-8"))))
    calls = [(n.func.attr, n.args) for n in nodes if isinstance(n, ast.Call) and isinstance(n.func, ast.Attribute)]
    named = {str(ast.literal_eval(given[0])) for name, given in calls if name == "add_argument"}
    texts = {n.value for n in nodes if isinstance(n, ast.Constant)}
    has_subcommands = any(name == "add_subparsers" for name, _ in calls)
    return options_in(words) <= {"--help", *named} and (not has_subcommands or words[0] in texts)


def options_in(words: list[str]) -> set[str]:
    return {word.partition("=")[0] for word in words if re.fullmatch(r"--?[a-z][\w-]*(=.*)?", word)}


@pytest.mark.parametrize("document", DOCUMENTS)
def test_links_lead_somewhere(document: str) -> None:
    dead = []
    for link in LINK.findall(FENCE.sub("", text_of(document))):
        if re.match(r"[a-z]+:", link):
            continue
        name, _, anchor = unquote(link).partition("#")
        target = (ROOT / document).parent / name if name else ROOT / document
        if not target.exists() or (anchor and anchor not in anchors(target)):
            dead.append(link)
    assert not dead


@pytest.mark.parametrize("document", DOCUMENTS)
def test_cartier_commands_exist(document: str) -> None:
    unknown = []
    for words in commands(document, "cartier"):
        if not words or not re.fullmatch(r"[a-z][\w-]*", words[0]):
            continue  # `cartier --help`, or the name alone
        two = " ".join(words[:2])
        known = command_line().get(two if any(name.startswith(f"{words[0]} ") for name in command_line()) else words[0])
        if known is None or options_in(words) - known:
            unknown.append(" ".join(["cartier", *words]))
    assert not unknown


@pytest.mark.parametrize("document", DOCUMENTS)
def test_script_commands_exist(document: str) -> None:
    unknown = []
    for words in commands(document, "python"):
        if not words or not words[0].endswith(".py"):
            continue
        script = ROOT / words[0]
        if not script.is_file() or not script_knows(script, words[1:]):
            unknown.append(" ".join(words))
    assert not unknown


def test_commands_are_found_in_documents() -> None:
    """The checks above look at something."""
    assert sum(len(list(commands(document, "cartier"))) for document in DOCUMENTS) > 50
    assert sum(len(list(commands(document, "python"))) for document in DOCUMENTS) > 20


@pytest.mark.parametrize("document", DOCUMENTS)
def test_python_blocks_compile(document: str) -> None:
    for kind, block in FENCE.findall(text_of(document)):
        if kind == "python" and document != "docs/api.md":  # which shows signatures
            compile(block, document, "exec")


def test_readme_sample_runs_without_a_key(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The home that ``cartier demo`` leaves is a small one with a bed here."""
    for name in ("OPENAI_API_KEY", "OPENAI_BASE_URL", "CARTIER_MODEL"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.chdir(tmp_path)
    bed = box(1, "bed", (1.0, 2.6, 0.0), (3.0, 4.0, 0.5))
    map_home(walk([bed]), TrueBoxes([bed])).save(tmp_path / "cartier-demo" / "home")
    (block,) = [block for kind, block in FENCE.findall(text_of("README.md")) if kind == "python"]
    exec(compile(block, "README.md", "exec"), {})
    assert capsys.readouterr().out.startswith("bed ")


def test_readme_names_of_the_sample_exist() -> None:
    """The line that is commented out, for recordings of one's own, calls what there is."""
    (line,) = re.findall(r"^# of your own: (.+)$", text_of("README.md"), re.MULTILINE)
    called = {node.attr for node in ast.walk(ast.parse(line)) if isinstance(node, ast.Attribute)}
    assert called == {"map_home", "open_recording", "make", "save"}
    assert all(hasattr(cartier, name) for name in called - {"save"}) and hasattr(cartier.Home, "save")


@pytest.mark.slow
def test_readme_shows_the_demo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The rows and answers of the demo's home that README prints are those of a run."""
    monkeypatch.chdir(tmp_path)
    run = CliRunner()
    assert run.invoke(app, ["demo"]).exit_code == 0
    shown = run.invoke(app, ["show", "cartier-demo/home"]).output.splitlines()
    (block,) = [
        block for _, block in FENCE.findall(text_of("README.md")) if "$ cartier show cartier-demo/home" in block
    ]
    printed = [" ".join(line.split()) for line in block.splitlines()[1:] if line.strip(" …")]
    assert not set(printed) - {" ".join(line.split()) for line in shown}
    asked = re.findall(r'^\$ cartier ask cartier-demo/home "(.+)"\n(.+)$', text_of("README.md"), re.MULTILINE)
    assert len(asked) >= 5
    for words, first in asked:
        assert run.invoke(app, ["ask", "cartier-demo/home", words]).output.splitlines()[0] == first


def test_design_names_every_package() -> None:
    tree = text_of("docs/design.md").partition("## 2. The layout")[2].partition("\n## 3.")[0]
    core = {path.parent.name for path in (ROOT / "src/cartier").glob("*/__init__.py")}
    named = set(re.findall(r"(\w+)/", tree))
    assert not core - named
    beside = {path.name for path in (ROOT / "src").glob("cartier_*")}
    assert beside == set(re.findall(r"^src/(cartier_\w+)/", tree, re.MULTILINE))


def test_readme_is_short() -> None:
    assert text_of("README.md").count("\n") <= 150

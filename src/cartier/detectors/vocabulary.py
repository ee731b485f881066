"""The names that a zero-shot detector is asked for: LVIS's 1,203 by default, or those of a text file or a list."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from cartier.errors import InputError
from cartier.io.files import read_text
from cartier.labels import MAX_NAME_CHARS, display_name

LVIS = Path(__file__).parent / "labels" / "lvis.tsv"
MAX_NAMES = 10_000  # eight times LVIS; the scores of one OWLv2 frame then take 144 MB
MAX_BYTES = 4 * 2**20
SHOWN = 3  # how many of the names in question a note or a message spells out


@dataclass(frozen=True)
class Vocabulary:
    """Unique display names in their given order. ``synonyms`` has the other words for a name, where any are known.

    ``notes`` are lines about what was merged or left out.
    """

    names: tuple[str, ...]
    synonyms: dict[str, tuple[str, ...]]
    source: str
    notes: tuple[str, ...] = ()


def read_vocabulary(given: str | Path | Sequence[str] | None = None) -> Vocabulary:
    """The names in a text file or a list, or LVIS's (Gupta et al., CVPR 2019) if ``given`` is None.

    The file is UTF-8, one name a line; after a tab may follow synonyms, and lines that begin with ``#`` are comments.
    Blank names are left out and duplicates (equal as display names) merged, and ``notes`` say so. Raises InputError for
    a file that cannot be read, for what is no list of names, and for none or more than MAX_NAMES of them.
    """
    if given is None:
        return _vocabulary(_lines(LVIS), "LVIS")
    if isinstance(given, str | Path):
        return _vocabulary(_lines(Path(given)), Path(given).name)
    wrong = next((name for name in given if not isinstance(name, str)), None)
    if wrong is not None:
        raise InputError(f"a vocabulary is a text file or a list of names, but this list holds {wrong!r:.60}")
    return _vocabulary(([name] for name in given), "a list")


def _lines(path: Path) -> Iterable[list[str]]:
    """Each line of a vocabulary file that is no comment, as its name and synonyms."""
    try:
        text = read_text(path, MAX_BYTES)
    except InputError as error:
        raise InputError(f"vocabulary {error}: it is a text file, one name a line") from error
    return [line.split("\t") for line in text.splitlines() if not line.startswith("#")]


def _vocabulary(rows: Iterable[Sequence[str]], source: str) -> Vocabulary:
    rows = list(rows)
    if any(len(word) > MAX_NAME_CHARS for row in rows for word in row):
        raise InputError(f"vocabulary {source} holds a name of more than {MAX_NAME_CHARS} characters: write one a line")
    named = [[display_name(word) for word in row] for row in rows]
    count = Counter(row[0] for row in named if row[0])
    if not count:
        raise InputError(f"vocabulary {source} holds no name: write one a line")
    if len(count) > MAX_NAMES:
        raise InputError(f"vocabulary {source} holds {len(count)} names; at most {MAX_NAMES} can be asked for")
    synonyms: dict[str, tuple[str, ...]] = {}
    for name, *others in named:
        known = synonyms.get(name, ())
        synonyms[name] = known + tuple(dict.fromkeys(word for word in others if word and word not in (name, *known)))
    notes = []
    blank, twice = len(named) - count.total(), [name for name, times in count.items() if times > 1]
    if blank:
        notes.append(f"vocabulary {source}: {blank} blank names are left out")
    if twice:
        merged = f"{count.total() - len(count)} duplicates are merged"
        notes.append(f"vocabulary {source}: {merged} ({shortened(twice)})")
    return Vocabulary(tuple(count), {name: synonyms[name] for name in count if synonyms[name]}, source, tuple(notes))


def shortened(names: Sequence[str]) -> str:
    """The first few names, each cut to a readable length, for notes and messages."""
    shown = ", ".join(f'"{name if len(name) <= 40 else name[:39] + "…"}"' for name in names[:SHOWN])
    return f"{shown} …" if len(names) > SHOWN else shown

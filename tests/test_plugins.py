from __future__ import annotations

from pathlib import Path

import pytest

from cartier import plugins
from cartier.errors import BackendError, InputError, MissingExtra


def test_every_backend_says_what_it_is_and_loads_or_names_its_extra() -> None:
    for kind in plugins.KINDS:
        for backend in plugins.backends(kind):
            assert backend.summary, f"{kind}/{backend.name} has no first docstring line"


def test_unknown_names_teach() -> None:
    with pytest.raises(BackendError, match=r"no 'object_dept' among the indexes; did you mean 'object_depth'"):
        plugins.make("indexes", "object_dept")
    with pytest.raises(BackendError, match="has no option 'colour'; it has encoder, cell_m"):
        plugins.make("indexes", "vlmaps", colour="red")
    with pytest.raises(BackendError, match="kinds are recordings"):
        plugins.backends("sofas")


def test_a_file_is_a_backend(tmp_path: Path) -> None:
    mine = tmp_path / "mine.py"
    mine.write_text('"""My own."""\ndef make(size=1):\n    return ("mine", size)\n')
    assert plugins.make("detectors", str(mine), size=3) == ("mine", 3)
    mine.write_text("def make(:\n")
    with pytest.raises(BackendError, match=r"mine\.py line 1"):
        plugins.make("detectors", str(mine))
    mine.write_text("x = 1\n")
    with pytest.raises(BackendError, match=r"no function make"):
        plugins.make("detectors", str(mine))
    with pytest.raises(BackendError, match="does not exist"):
        plugins.make("detectors", str(tmp_path / "other.py"))


def test_only_a_foreign_missing_module_is_called_missing(tmp_path: Path) -> None:
    mine = tmp_path / "mine.py"
    mine.write_text('"""My own."""\nimport a_package_that_nobody_has\n')
    with pytest.raises(
        MissingExtra, match=r"needs the package 'a_package_that_nobody_has': pip install 'a_package_that_nobody_has'"
    ):
        plugins.make("detectors", str(mine))
    mine.write_text("import cartier.no_such_part\n")
    with pytest.raises(ModuleNotFoundError, match=r"cartier\.no_such_part"):
        plugins.make("detectors", str(mine))


def test_what_is_no_recording_is_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="does not exist"):
        plugins.open_recording(tmp_path / "nowhere")
    with pytest.raises(InputError, match=r"no recording that cartier knows.*folder"):
        plugins.open_recording(tmp_path)

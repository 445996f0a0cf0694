"""Fixtures for every tier. Tests marked `needs_data` are left out, and counted, where the recordings are absent."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]
DATA_FOLDER = Path(os.environ.get("CBM_DATA") or REPOSITORY.parent / "shared").resolve()
HAS_DATA = (DATA_FOLDER / "mocap").is_dir() and (DATA_FOLDER / "takes").is_dir()

left_out = pytest.StashKey[int]()


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """The folder that holds `mocap/` and `takes/`; its tests are marked `needs_data`."""
    assert HAS_DATA, f"{DATA_FOLDER} has no mocap/ and takes/: mark this test `needs_data`"
    return DATA_FOLDER


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if HAS_DATA:
        return
    without_data = [item for item in items if item.get_closest_marker("needs_data")]
    config.stash[left_out] = len(without_data)
    config.hook.pytest_deselected(items=without_data)
    items[:] = [item for item in items if item not in without_data]


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    if count := config.stash.get(left_out, 0):
        terminalreporter.write_line(f"{count} tests left out: they need recordings; set CBM_DATA to the folder that holds mocap/ and takes/")

"""Outputs: never half-written, never over something of the user's."""

from __future__ import annotations

from pathlib import Path

import pytest

from cbm_addon.errors import InputError
from cbm_addon.outputs import replacing, replacing_all


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_file_takes_its_name_only_at_the_end(tmp_path):
    output = tmp_path / "take.bvh"
    with replacing(output, overwrite=False) as temporary:
        temporary.write_text("new")
        assert temporary.parent == tmp_path
        assert temporary.suffix == ".bvh"
        assert not output.exists()
    assert output.read_text() == "new"
    assert names(tmp_path) == ["take.bvh"]


def test_existing_file_is_refused_before_any_work(tmp_path):
    output = tmp_path / "take.bvh"
    output.write_text("old")
    with pytest.raises(InputError, match="exists; pass --overwrite"), replacing(output, overwrite=False):
        pytest.fail("the body ran")
    assert output.read_text() == "old"


def test_existing_file_is_replaced_with_overwrite(tmp_path):
    output = tmp_path / "take.bvh"
    output.write_text("old")
    with replacing(output, overwrite=True) as temporary:
        temporary.write_text("new")
    assert output.read_text() == "new"
    assert names(tmp_path) == ["take.bvh"]


@pytest.mark.parametrize("interruption", [ValueError, KeyboardInterrupt])
def test_interrupted_body_leaves_the_folder_as_it_was(tmp_path, interruption):
    output = tmp_path / "take.bvh"
    output.write_text("old")
    with pytest.raises(interruption), replacing(output, overwrite=True) as temporary:
        temporary.write_text("half")
        raise interruption
    assert output.read_text() == "old"
    assert names(tmp_path) == ["take.bvh"]


def test_the_file_may_be_named_from_the_working_folder(tmp_path, monkeypatch):
    """Blender reads relative paths in its own way: what the body gets is absolute."""
    monkeypatch.chdir(tmp_path)
    with replacing("take.bvh", overwrite=False) as temporary:
        assert temporary.is_absolute()
        temporary.write_text("new")
    assert names(tmp_path) == ["take.bvh"]


def test_several_files_appear_together_or_not_at_all(tmp_path):
    outputs = [tmp_path / "bake.blend", tmp_path / "bake.png"]
    with pytest.raises(FileNotFoundError), replacing_all(outputs, overwrite=False) as (blend, _picture):
        blend.write_text("the picture was never written")
    assert names(tmp_path) == []
    with replacing_all(outputs, overwrite=False) as temporaries:
        for temporary in temporaries:
            temporary.write_text(temporary.suffix)
    assert [output.read_text() for output in outputs] == [".blend", ".png"]


def test_outputs_that_cannot_be_made_are_refused(tmp_path):
    with pytest.raises(InputError, match="folder does not exist"), replacing(tmp_path / "absent" / "x.bvh", overwrite=False):
        pytest.fail("the body ran")
    with pytest.raises(InputError, match="is a folder"), replacing(tmp_path, overwrite=True):
        pytest.fail("the body ran")
    with pytest.raises(InputError, match="named twice"), replacing_all([tmp_path / "x", tmp_path / "." / "x"], overwrite=False):
        pytest.fail("the body ran")

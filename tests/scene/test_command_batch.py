"""`cbm batch`: the takes that are sound are baked whatever the others are, and a second run does what is left."""

from __future__ import annotations

import json
from pathlib import Path

import bpy
import pytest

from cbm_addon.cli import main
from cbm_addon.scene.rigify import rigify_metarig

SAMPLE = Path(__file__).resolve().parents[2] / "cbm_addon" / "takes" / "sample" / "walk_turn_crouch.csv"

JOB = """
output = "out"
takes = ["*.csv"]

[options]
variations = 2

[[rigs]]
blend = "scene.blend"
rig = "Hero"

[[rigs]]
preset = "rigify-metarig"
part = "lower"
"""


@pytest.fixture
def folder(empty_scene: bpy.types.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    lines = SAMPLE.read_text(encoding="utf-8").splitlines(keepends=True)
    (tmp_path / "walk.csv").write_text("".join(lines[: 2 + 73]), encoding="utf-8")
    (tmp_path / "broken.csv").write_text("no take", encoding="utf-8")
    (tmp_path / "job.toml").write_text(JOB, encoding="utf-8")
    rigify_metarig(bpy.context).name = "Hero"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def baked(folder: Path) -> dict[Path, int]:
    return {path.relative_to(folder): path.stat().st_mtime_ns for path in sorted((folder / "out").rglob("*")) if path.is_file()}


def test_a_broken_take_does_not_stop_the_others_and_a_second_run_does_what_is_left(folder, capsys):
    assert main(["batch", "job.toml", "--workers", "2", "--json", "first.json", "--quiet"]) == 2
    said = capsys.readouterr()
    assert said.err == "error: job.toml: 2 of 4 tasks failed; see the lines above, and run it again for these alone once they are mended\n"
    assert "Hero/broken: failed: broken.csv: is not a take" in said.out
    report = json.loads((folder / "first.json").read_text())
    assert {task["name"]: task["state"] for task in report["tasks"]} == {
        "Hero/broken": "failed",
        "Hero/walk": "done",
        "rigify-metarig/broken": "failed",
        "rigify-metarig/walk": "done",
    }
    before = baked(folder)
    assert set(before) == {Path("out/Hero/walk.blend"), Path("out/rigify-metarig/walk.blend")}
    for blend, rig in zip(before, ("Hero", "metarig"), strict=True):
        bpy.ops.wm.open_mainfile(filepath=str(blend))
        assert sorted(bpy.data.actions.keys()) == ["walk_variation0", "walk_variation1"]
        assert [obj.name for obj in bpy.data.objects if obj.type == "ARMATURE"] == [rig]

    (folder / "broken.csv").write_bytes((folder / "walk.csv").read_bytes())
    assert main(["batch", "job.toml", "--json", "second.json", "--quiet"]) == 0
    assert [task["state"] for task in json.loads((folder / "second.json").read_text())["tasks"]] == ["done", "kept", "done", "kept"]
    after = baked(folder)
    assert {path: after[path] for path in before} == before
    assert len(after) == 4

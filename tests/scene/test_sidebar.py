"""The panel draws what there is: every property, operator and icon that it names exists in this version of Blender."""

from __future__ import annotations

from types import ModuleType, SimpleNamespace

import bpy
import pytest

ICONS = set(bpy.types.UILayout.bl_rna.functions["prop"].parameters["icon"].enum_items.keys())


class Layout:
    """A layout that notes the labels it is given and checks what it is asked to show."""

    def __init__(self, shown: list[str]) -> None:
        self.shown = shown

    def box(self) -> Layout:
        return Layout(self.shown)

    def row(self, align: bool = False) -> Layout:
        return Layout(self.shown)

    column = row

    def label(self, text: str, icon: str = "NONE") -> None:
        assert icon in ICONS
        self.shown.append(text)

    def prop(self, data: object, name: str, icon: str = "NONE", **more: object) -> None:
        assert name in data.bl_rna.properties
        assert icon in ICONS
        self.shown.append(name)

    def operator(self, name: str, icon: str = "NONE", **more: object) -> SimpleNamespace:
        assert name.removeprefix("cbm.") in dir(bpy.ops.cbm)
        assert icon in ICONS
        self.shown.append(name)
        return SimpleNamespace()


@pytest.fixture
def draw(extension: ModuleType):
    def shown() -> list[str]:
        found: list[str] = []
        context = SimpleNamespace(scene=bpy.context.scene, preferences=SimpleNamespace(system=SimpleNamespace(ui_scale=1.0)), region=SimpleNamespace(width=300))
        panel = SimpleNamespace(layout=Layout(found))
        cls = bpy.types.CBM_PT_sidebar
        for name in ("_take", "_rig", "_model", "_bake", "_fingers"):
            setattr(panel, name, getattr(cls, name).__get__(panel))
        cls.draw(panel, context)
        return found

    return shown


def test_its_five_steps_stand_in_order(draw):
    headings = [text for text in draw() if text[:2] in {f"{step}." for step in range(1, 7)}]
    assert headings == ["1. Take", "2. Rig", "3. Model", "4. Bake", "5. Fingers and Body"]


def test_it_shows_what_became_of_the_fingers(draw):
    bpy.context.scene.cbm.fingers.summary = "Left: 9 of 10 frames pierced, 0 do now"
    assert any("frames pierced" in text for text in draw())


def test_it_clears_the_body_and_shows_what_became_of_it(draw):
    shown = draw()
    assert shown.index("5. Fingers and Body") < shown.index("hold") < shown.index("cbm.clear_body")
    assert not any("meets nothing" in text for text in shown)
    bpy.context.scene.cbm.fingers.body_summary = "the body meets nothing in 10 frames"
    assert any("meets nothing" in text for text in draw())

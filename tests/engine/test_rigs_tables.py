"""Maps of bones: what is saved is what is loaded, and a file that is no map is refused in one line."""

from __future__ import annotations

import json

import pytest

from cbm_addon.errors import InputError
from cbm_addon.rigs.recognize import recognize
from cbm_addon.rigs.tables import JOINTS, load_table, save_map, tables
from tests.sample_rigs import SAMPLE_RIGS, bones_at_rest, renamed


@pytest.mark.parametrize("sample", SAMPLE_RIGS, ids=lambda sample: sample.name)
@pytest.mark.parametrize("change", [lambda bones: bones, renamed], ids=["by names", "by shape"])
def test_a_saved_map_gives_the_same_mapping(sample, change, tmp_path):
    bones = change(bones_at_rest(sample, "A"))
    mapping = recognize(bones).mapping
    save_map(tmp_path / "map.json", mapping)
    again = recognize(bones, load_table(tmp_path / "map.json")).mapping
    assert again == mapping


def test_a_map_can_be_corrected_by_hand_and_shared(tmp_path):
    bones = bones_at_rest(next(sample for sample in SAMPLE_RIGS if sample.name == "Unreal 5"))
    save_map(tmp_path / "map.json", recognize(bones).mapping)
    content = json.loads((tmp_path / "map.json").read_text())
    content["joints"]["Spine1"] = ["spine_99", "spine_03"]
    del content["joints"]["LeftToe"]
    (tmp_path / "map.json").write_text(json.dumps(content))
    mapping = recognize(bones, load_table(tmp_path / "map.json")).mapping
    assert mapping.joints["Spine1"] == "spine_03"
    assert "LeftToe" not in mapping.joints


def test_joints_alone_make_a_map(tmp_path):
    sample = SAMPLE_RIGS[0]
    (tmp_path / "mine.json").write_text(json.dumps({"joints": sample.joints}))
    table = load_table(tmp_path / "mine.json")
    assert (table.kind, table.title) == ("mine", "mine")
    mapping = recognize(bones_at_rest(sample), table).mapping
    assert mapping.joints | mapping.fingers == sample.joints


def test_a_map_is_not_written_over(tmp_path):
    mapping = recognize(bones_at_rest(SAMPLE_RIGS[0])).mapping
    (tmp_path / "map.json").write_text("mine")
    with pytest.raises(InputError, match="--overwrite"):
        save_map(tmp_path / "map.json", mapping)
    assert (tmp_path / "map.json").read_text() == "mine"
    save_map(tmp_path / "map.json", mapping, overwrite=True)
    assert load_table(tmp_path / "map.json").kind == "mixamo"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("no JSON", "is not JSON"),
        ("[]", 'an object with "joints"'),
        ('{"joints": "all"}', 'an object with "joints"'),
        ('{"joints": {"Tail": "tail"}}', "the joint Tail, which no body has"),
        ('{"joints": {"Hips": 3}}', "names a bone 3"),
        ('{"joints": {"Hips": "hips"}, "twists": {"LeftFoot": ["a"]}}', "the twist LeftFoot"),
        ('{"joints": {"Hips": "hips"}, "controls": [{"bone": "a"}]}', "not complete"),
    ],
)
def test_a_file_that_is_no_map_is_refused_in_one_line(tmp_path, content, message):
    (tmp_path / "map.json").write_text(content)
    with pytest.raises(InputError, match=message) as error:
        load_table(tmp_path / "map.json")
    assert "\n" not in str(error.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"absent\.json: cannot be read"):
        load_table(tmp_path / "absent.json")


def test_shipped_tables_name_known_joints_and_say_where_their_names_come_from():
    assert len(tables()) >= 15
    for table in tables():
        assert set(table.joints) <= set(JOINTS)
        assert table.source.strip()
        names = [name for options in table.joints.values() for name in options[:1]]
        assert len(set(names)) == len(names), table.kind

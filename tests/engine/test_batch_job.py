"""The file of a batch: what it says, and how it is refused."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import pytest

from cbm_addon.cli import main
from cbm_addon.commands import batch_workers
from cbm_addon.commands.batch_job import BakeParser, Task, read_job
from cbm_addon.commands.batch_workers import working
from cbm_addon.errors import InputError
from cbm_addon.progress import run

RIGS = '[[rigs]]\npreset = "rigify-metarig"\n'


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("takes/b.csv", "takes/a.csv", "more/a.csv", "more/c.bsor", "hero.blend"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    return tmp_path


def job(folder: Path, text: str) -> list[Task]:
    (folder / "job.toml").write_text(text)
    return read_job(folder / "job.toml")


def told(task: Task):
    """What `bake` understands of a task."""
    return BakeParser().parse_args(task.argv)


def test_every_take_goes_onto_every_rig_into_a_file_of_its_own(folder):
    tasks = job(folder, 'output = "out"\ntakes = ["takes/*.csv"]\n[[rigs]]\nblend = "hero.blend"\nrig = "Arma ture"\nname = "hero"\n' + RIGS)
    assert [task.name for task in tasks] == ["hero/a", "hero/b", "rigify-metarig/a", "rigify-metarig/b"]
    assert tasks[0].outputs == (folder / "out/hero/a.blend",)
    args = told(tasks[0])
    assert (args.takes, args.blend, args.rig, args.output) == ([folder / "takes/a.csv"], folder / "hero.blend", "Arma ture", folder / "out/hero/a.blend")
    assert told(tasks[2]).preset == "rigify-metarig"


def test_options_of_takes_go_before_those_of_rigs_and_those_before_the_jobs(folder):
    tasks = job(
        folder,
        """
        output = "out"
        [options]
        variations = 3
        seed = 1
        eye-height = 1.6
        wrist-offset = [-0.01, 0.1, 0]
        swap-hands = false
        model = "models/mine"
        preview = ["png", "mp4"]
        [[takes]]
        files = "takes/a.csv"
        seed = 3
        seated = true
        [[takes]]
        files = "takes/b.csv"
        seated = false
        [[rigs]]
        preset = "rigify"
        seed = 2
        root = "object"
        """,
    )
    first, second = (told(task) for task in tasks)
    assert (first.variations, first.seed, first.eye_height, first.seated, first.root) == (3, 3, 1.6, True, "object")
    assert (second.seed, second.seated, second.swap_hands, second.wrist_offset) == (2, False, False, (-0.01, 0.1, 0.0))
    assert first.model == folder / "models/mine"
    assert first.preview == list(tasks[0].outputs[1:]) == [folder / "out/rigify/a.png", folder / "out/rigify/a.mp4"]


def test_takes_of_one_name_are_told_apart_by_their_folders(folder):
    tasks = job(folder, 'output = "out"\ntakes = ["*/a.csv", "more/c.bsor"]\n' + RIGS)
    assert [task.name.removeprefix("rigify-metarig/") for task in tasks] == ["more_a", "takes_a", "c"]


def test_a_take_that_is_not_there_is_a_matter_of_its_task(folder):
    (task,) = job(folder, 'output = "out"\ntakes = ["absent.csv"]\n' + RIGS)
    assert task.take == folder / "absent.csv"


def test_a_task_is_made_when_all_its_files_are_there(folder):
    (task,) = job(folder, 'output = "."\ntakes = ["takes/a.csv"]\n[options]\npreview = "png"\n' + RIGS)
    (folder / "rigify-metarig").mkdir()
    task.outputs[0].touch()
    assert not task.is_made
    task.outputs[1].touch()
    assert task.is_made


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("takes = [", "is not TOML"),
        ('takes = ["a.csv"]\n' + RIGS, "'output' at the top is missing"),
        ('output = "o"\n' + RIGS, "'takes' is missing"),
        ('output = "o"\ntakes = ["a.csv"]', "'rigs' is missing"),
        ('output = "o"\ntakes = []\n' + RIGS, "'takes' is []"),
        ('output = "o"\ntake = ["a.csv"]\n' + RIGS, "unknown key 'take' at the top; known are output, options, takes, rigs"),
        ('output = "o"\ntakes = ["a.csv"]\n[options]\nvariation_s = 2\n' + RIGS, "unknown key 'variation_s' [options]; known are "),
        ('output = "o"\ntakes = [{file = "a.csv"}]\n' + RIGS, "unknown key 'file' in [[takes]]; known are files, "),
        ('output = "o"\ntakes = ["a.csv"]\n[[rigs]]\nfile = "x"\n', "unknown key 'file' in [[rigs]]; known are name, blend, rig, preset, "),
        ('output = "o"\ntakes = ["*.fbx"]\n' + RIGS, "'*.fbx' in takes matches no file"),
        ('output = "o"\ntakes = ["a.csv"]\n[options]\nmode = "psychic"\n' + RIGS, "mode: invalid choice: 'psychic'"),
        ('output = "o"\ntakes = ["a.csv"]\n[options]\nseated = 1\n' + RIGS, "'seated' [options] is 1; true or false"),
        ('output = "o"\ntakes = ["a.csv"]\n[options]\npreview = "gif"\n' + RIGS, "'preview' [options] is 'gif'; png or mp4"),
        ('output = "o"\ntakes = ["a.csv"]\n[options]\npreset = "rigify"\n' + RIGS, "unknown key 'preset' [options]"),
        ('output = "o"\ntakes = ["a.csv"]\n[[rigs]]\nrig = "Hero"\n', "needs 'blend' and 'rig'"),
        ('output = "o"\ntakes = ["a.csv"]\n[[rigs]]\nblend = "nobody.blend"\nrig = "Hero"\n', "nobody.blend: does not exist"),
        ('output = "o"\ntakes = ["a.csv"]\n[[rigs]]\npreset = "rigify"\nname = "../x"\n', "'../x' in [[rigs]] cannot be the name of a folder"),
        ('output = "o"\ntakes = ["a.csv"]\n' + RIGS + RIGS, "two rigs are called 'rigify-metarig'"),
        ('output = "o"\ntakes = ["takes/a.csv", "takes/a.csv"]\n' + RIGS, "two takes are called 'takes_a'"),
    ],
)
def test_what_is_wrong_is_said_before_anything_is_done(folder, text, message):
    with pytest.raises(InputError) as refusal:
        job(folder, text)
    assert message in str(refusal.value)


def test_a_file_that_is_not_there_is_one_line(capsys, tmp_path):
    assert main(["batch", str(tmp_path / "job.toml")]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert "job.toml: cannot be read" in err


def test_workers_that_die_fail_their_tasks_and_leave_nothing(folder, monkeypatch):
    """As one that runs out of memory does, in the middle of writing."""
    dies = "import json, os, pathlib, sys; out = pathlib.Path(json.loads(sys.stdin.readline())[3]); "
    dies += "(out.parent / f'.{out.stem}.{os.getpid()}.blend').touch(); print('no memory', file=sys.stderr); os._exit(7)"
    monkeypatch.setattr(batch_workers, "worker_command", lambda folder, threads: [sys.executable, "-c", dies])
    tasks = job(folder, 'output = "out"\ntakes = ["takes/*.csv"]\n' + RIGS)
    outcomes = run(working(tasks, 1, overwrite=False))
    assert [outcome.error for outcome in outcomes] == ["its process ended with code 7: no memory"] * 2
    assert not list((folder / "out" / "rigify-metarig").iterdir())


def test_a_cancelled_batch_ends_its_workers_and_leaves_nothing(folder, monkeypatch):
    writes = "import json, os, pathlib, sys, time; out = pathlib.Path(json.loads(sys.stdin.readline())[3]); "
    writes += "(out.parent / f'.{out.stem}.{os.getpid()}.blend').touch(); print(json.dumps({'share': 0.5}), flush=True); time.sleep(600)"
    monkeypatch.setattr(batch_workers, "worker_command", lambda folder, threads: [sys.executable, "-c", writes])
    temporary, workers = folder / "temporary", []
    temporary.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))

    class Watched(batch_workers.Worker):
        def __init__(self, *args) -> None:
            super().__init__(*args)
            workers.append(self)

    monkeypatch.setattr(batch_workers, "Worker", Watched)
    tasks = job(folder, 'output = "out"\ntakes = ["takes/*.csv"]\n' + RIGS)
    batch = working(tasks, 2, overwrite=False)
    while next(batch).share < 0.5:
        pass
    batch.close()
    assert [worker.process.poll() is not None for worker in workers] == [True, True]
    assert not list((folder / "out" / "rigify-metarig").iterdir())
    assert not list(temporary.iterdir())

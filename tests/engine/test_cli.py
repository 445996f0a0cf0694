"""The command line: exit codes, one-line errors, the JSON report, the progress bar."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from cbm_addon import __version__, cli
from cbm_addon.errors import InputError
from cbm_addon.progress import Progress

REPOSITORY = Path(__file__).resolve().parents[2]


@pytest.fixture
def command(monkeypatch):
    """Puts one command named `probe IN` on the command line; the test gives its `run`."""

    def put(run):
        probe = SimpleNamespace(HELP="a command of this test", add_arguments=lambda parser: parser.add_argument("input"), run=run)
        monkeypatch.setattr(cli, "COMMANDS", ("probe",))
        monkeypatch.setitem(sys.modules, "cbm_addon.commands.probe", probe)

    return put


def raising(error):
    def run(args, console):
        raise error

    return run


def job():
    for step in range(4):
        yield Progress(step / 4, "solving")
    return "result"


def test_done_is_0_and_lines_go_to_stdout(command, capsys):
    command(lambda args, console: console.say(f"read {args.input}") or {})
    assert cli.main(["probe", "take.csv"]) == 0
    assert capsys.readouterr().out == "read take.csv\n"


@pytest.mark.parametrize("argv", [[], ["nonsense"], ["probe"], ["probe", "take.csv", "--nonsense"]])
def test_bad_usage_is_2_with_one_line(command, capsys, argv):
    command(lambda args, console: {})
    assert cli.main(argv) == 2
    out, err = capsys.readouterr()
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert out == ""


def test_bad_input_is_2_with_one_line_that_names_the_file(command, capsys):
    command(raising(InputError("take.csv", "has no column 'head_px';\nwrite it with cbm convert")))
    assert cli.main(["probe", "take.csv"]) == 2
    assert capsys.readouterr().err == "error: take.csv: has no column 'head_px'; write it with cbm convert\n"


def test_fault_of_ours_is_1_with_the_traceback(command, capsys):
    command(raising(ZeroDivisionError("ours")))
    assert cli.main(["probe", "take.csv"]) == 1
    err = capsys.readouterr().err
    assert "Traceback" in err
    assert "ZeroDivisionError: ours" in err


def test_ctrl_c_is_130(command, capsys):
    command(raising(KeyboardInterrupt()))
    assert cli.main(["probe", "take.csv"]) == 130
    assert capsys.readouterr().err == "cancelled\n"


def test_help_returns_instead_of_leaving_the_process(command, capsys):
    command(lambda args, console: {})
    assert cli.main(["--help"]) == 0
    assert "a command of this test" in capsys.readouterr().out


def test_json_report_holds_what_the_command_returned(command, tmp_path):
    report = tmp_path / "report.json"
    report.write_text("an old report")
    command(lambda args, console: {"output": Path("x.bvh"), "error_cm": np.float32(0.5), "gaps": np.zeros(2), "jitter": (1.0, float("nan"))})
    assert cli.main(["probe", "take.csv", "--json", str(report)]) == 0
    facts = json.loads(report.read_text())
    assert facts.pop("seconds") >= 0
    assert facts == {"command": "probe", "version": __version__, "output": "x.bvh", "error_cm": 0.5, "gaps": [0.0, 0.0], "jitter": [1.0, None]}


def test_failed_command_leaves_an_old_report_as_it_was(command, tmp_path):
    report = tmp_path / "report.json"
    report.write_text("an old report")
    command(raising(InputError("take.csv", "is empty")))
    assert cli.main(["probe", "take.csv", "--json", str(report)]) == 2
    assert [path.read_text() for path in tmp_path.iterdir()] == ["an old report"]


def test_progress_goes_to_stderr_and_quiet_hides_it(command, capsys):
    command(lambda args, console: {"result": console.run(job())})
    assert cli.main(["probe", "take.csv"]) == 0
    out, err = capsys.readouterr()
    assert "solving" in err
    assert out == ""
    assert cli.main(["probe", "take.csv", "--quiet"]) == 0
    assert capsys.readouterr().err == ""


def test_on_a_terminal_progress_is_one_line_written_over(command, capsys, monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    command(lambda args, console: {"result": console.run(job())})
    assert cli.main(["probe", "take.csv"]) == 0
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert " 75%  solving" in err


def test_a_program_that_drives_a_command_reads_json_lines(command, capsys):
    command(lambda args, console: console.say(console.run(job())) or {})
    assert cli.main(["probe", "take.csv", "--json-lines"]) == 0
    out, err = capsys.readouterr()
    events = [json.loads(line) for line in out.splitlines()]
    assert events[:-1] == [{"share": step / 4, "message": "solving"} for step in range(4)]
    assert events[-1] == {"said": "result"}
    assert err == ""


def test_console_closes_a_job_that_is_interrupted(command, capsys):
    closed = []

    def interrupted():
        try:
            yield Progress(0.5, "solving")
            raise KeyboardInterrupt
        finally:
            closed.append(True)

    command(lambda args, console: console.run(interrupted()))
    assert cli.main(["probe", "take.csv"]) == 130
    assert closed == [True]


def test_python_m_runs_the_same_parser():
    done = subprocess.run([sys.executable, "-m", "cbm_addon", "nonsense"], cwd=REPOSITORY, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith("error: ")
    assert done.stderr.count("\n") == 1

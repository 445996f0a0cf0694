"""How long a solve takes, by stage, number of candidates and threads: `python benchmarks/solve.py` in an environment with onnxruntime.

The take is the shipped sample, played forth and back for five minutes. Every row is the best of the runs, in milliseconds per frame at 30
frames per second; the first column of ratios is against carrying the legs along, which learns nothing and passes the same stage 3.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(REPOSITORY))
os.environ.pop("OPENBLAS_CORETYPE", None)  # numpy at its own speed

import numpy as np  # noqa: E402

from cbm_addon.evaluate.baselines import carry_legs  # noqa: E402
from cbm_addon.features import STANDARD_PROPORTIONS  # noqa: E402
from cbm_addon.motion.skeleton import STANDARD_BODY  # noqa: E402
from cbm_addon.progress import run  # noqa: E402
from cbm_addon.solve.fuse import fuse  # noqa: E402
from cbm_addon.solve.models import Model, ModeNetworks, load_model  # noqa: E402
from cbm_addon.solve.perform import SolveOptions, at_rate, perform  # noqa: E402
from cbm_addon.takes.calibrate import calibrate  # noqa: E402
from cbm_addon.takes.sample_motion import sample_take  # noqa: E402
from cbm_addon.takes.take import Take  # noqa: E402

SECONDS = 300
CANDIDATES = (1, 8, 16, 32)
STAGES = ("estimate", "decode", "choose and join", "fuse")


@dataclass(frozen=True)
class TimedNetworks(ModeNetworks):
    """Networks that note how long they run."""

    seconds: dict[str, float] = field(default_factory=lambda: defaultdict(float))

    def estimate(self, *args):
        return self._timed("estimate", super().estimate, args)

    def decode(self, *args):
        return self._timed("decode", super().decode, args)

    def _timed(self, name: str, call: Callable, args: tuple):
        started = time.perf_counter()
        result = call(*args)
        self.seconds[name] += time.perf_counter() - started
        return result


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--runs", type=int, default=3, help="runs per row (default: 3)")
    parser.add_argument("--model", type=Path, help="model folder (default: the shipped one)")
    arguments = parser.parse_args()
    take = five_minutes()
    baseline = min(carried(take) for _ in range(arguments.runs))
    print(f"{len(take.times)} frames; legs carried: {baseline:.3f} ms per frame\n")
    print(f"{'mode':<11}{'threads':>8}{'K':>4}" + "".join(f"{stage:>17}" for stage in STAGES) + f"{'whole':>9}{'to carried':>12}")
    for threads in (1, 2):
        model = load_model(arguments.model, threads=threads)
        for mode in model.modes:
            for candidates in CANDIDATES:
                row = min((stages(take, model, SolveOptions(mode, candidates)) for _ in range(arguments.runs)), key=lambda row: sum(row.values()))
                whole = sum(row.values())
                said = "".join(f"{row[stage]:>17.3f}" for stage in STAGES)
                print(f"{mode:<11}{threads:>8}{candidates:>4}{said}{whole:>9.3f}{whole / baseline:>11.1f}x", flush=True)


def five_minutes() -> Take:
    """The sample, calibrated, at the engine's rate, forth and back until the time is full."""
    sample = at_rate(calibrate(sample_take()).take)
    count = len(sample.times)
    order = np.arange(int(SECONDS * 30)) % (2 * count - 2)
    order = np.minimum(order, 2 * count - 2 - order)
    return replace(
        sample, times=np.arange(len(order)) / 30, positions=sample.positions[order], rotations=sample.rotations[order], tracked=sample.tracked[order], extras={}
    )


def carried(take: Take) -> float:
    started = time.perf_counter()
    fuse(carry_legs(take, STANDARD_BODY, causal=False), take, take.times, STANDARD_BODY)
    return 1000 * (time.perf_counter() - started) / len(take.times)


def stages(take: Take, model: Model, options: SolveOptions) -> dict[str, float]:
    """Milliseconds per frame of each of STAGES."""
    given = model.networks(options.mode)
    timed = TimedNetworks(**{name.name: getattr(given, name.name) for name in fields(ModeNetworks)})
    started = time.perf_counter()
    performance = run(perform(take, STANDARD_BODY.height_above_toes("Head"), STANDARD_PROPORTIONS, replace(model, modes={options.mode: timed}), options))
    performed = time.perf_counter()
    fuse(performance, take, take.times, STANDARD_BODY)
    done = time.perf_counter()
    networks = sum(timed.seconds.values())
    seconds = {**timed.seconds, "choose and join": performed - started - networks, "fuse": done - performed}
    return {stage: 1000 * seconds[stage] / len(take.times) for stage in STAGES}


if __name__ == "__main__":
    main()

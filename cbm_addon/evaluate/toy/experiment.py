"""The experiment: every method learns the same pairs with the same budget and is measured by its answers."""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass
from functools import partial

import torch
from torch import Tensor

from ...progress import Progress, part
from .function import GAP, STORED, branch, spread_evenly, training_pairs
from .measures import branch_errors, coherent_share, parabola_share, positive_share, reconstruction_error, steepness
from .methods import CHANNELS, CLASSES, HIDDEN, Cvae, Database, Matching, Method, Network, Regressor, Vae, Vq
from .training import BATCH, LEARNING_RATE, train

NETWORKS: dict[str, Callable[[], Network]] = {
    "mlp": Regressor,
    "vae": partial(Vae, 0.01),
    "vq": Vq,
    "cvae": partial(Cvae, 0.01),
    "cm-kl": partial(Matching, "kl", 0.01, sees_x=True),
    "cm-kl-code-only": partial(Matching, "kl", 0.01, sees_x=False),
    "cm-probabilities": partial(Matching, "probabilities", 0.01, sees_x=True),
    "cm-probabilities-code-only": partial(Matching, "probabilities", 0.01, sees_x=False),
    "cm-paper": partial(Matching, "paper", 1.0, sees_x=True),
    "cm-paper-code-only": partial(Matching, "paper", 1.0, sees_x=False),
}
"""What is trained, by name. Of codebook matching: the matching loss, and whether the decoder sees the code only, as in the paper."""

FARTHER = 8.0  # the largest X of the extrapolation (Fig. 17); training ends at 1
NEAR_GAP = (0.4, 0.6)
ASKED, REPEATS = 250, 20  # steepnesses of each measure, and answers to each
DRAWN = 30  # steepnesses in a figure


@dataclass(frozen=True)
class Outcome:
    """What one method did.

    measures  by name, see `measure`
    inside    answers [DRAWN, POINTS] to X spread evenly over 0 to 1
    outside   the same over 0 to FARTHER
    near_gap  error [ASKED] at X spread evenly over NEAR_GAP, mean of REPEATS answers
    """

    measures: dict[str, float]
    inside: Tensor
    outside: Tensor
    near_gap: Tensor


def budget(steps: int, seed: int) -> dict[str, int | float]:
    """What all methods have in common."""
    return {
        "steps": steps,
        "batch": BATCH,
        "learning_rate": LEARNING_RATE,
        "hidden": HIDDEN,
        "channels": CHANNELS,
        "classes": CLASSES,
        "pairs": 2 * STORED,
        "seed": seed,
    }


def compare(steps: int, seed: int) -> Generator[Progress, None, dict[str, Outcome]]:
    """Trains every method for `steps` and measures it; {name: outcome}. Same steps and seed: same outcomes."""
    x, y = training_pairs(seed)
    outcomes = {"database": examine(Database(x, y), seed)}
    torch.set_flush_denormal(True)
    try:
        for i, (name, build) in enumerate(NETWORKS.items()):
            torch.manual_seed(seed)
            network = build()
            yield from part(train(network, x, y, steps, name), i / len(NETWORKS), (i + 1) / len(NETWORKS))
            outcomes[name] = examine(network, seed)
    finally:
        torch.set_flush_denormal(False)  # it is the processor's state: whoever calls may need small numbers
    return outcomes


@torch.no_grad()
def examine(method: Method, seed: int) -> Outcome:
    """Asks a method at X that it did not train on, inside the data, in the gap and beyond, and measures what it answers."""
    torch.manual_seed(seed)
    inside, gap, outside = (spread_evenly(*span, ASKED).repeat_interleave(REPEATS, dim=0) for span in ((0, 1), GAP, (0, FARTHER)))
    answers, in_gap, beyond = method.draw(inside), method.draw(gap), method.draw(outside)
    signs = torch.tensor([1.0, -1.0]).repeat(len(inside) // 2)[:, None]
    truth = signs * branch(inside)
    by_tenth = [positive_share(*tenth) for tenth in zip(inside.chunk(10), answers.chunk(10), strict=True)]
    near = spread_evenly(*NEAR_GAP, ASKED).repeat_interleave(REPEATS, dim=0)
    return Outcome(
        measures={
            "coherent": coherent_share(inside, answers),
            "positive": positive_share(inside, answers),
            "positive_least": min(by_tenth),
            "positive_most": max(by_tenth),
            "reconstruction_error": reconstruction_error(truth, method.rebuild(inside, truth)),
            "gap_error": float(branch_errors(gap, in_gap).mean()),
            "beyond_parabolas": parabola_share(beyond),
            "beyond_steepness": float(steepness(beyond).abs().max()),
        },
        inside=method.draw(spread_evenly(0, 1, DRAWN)),
        outside=method.draw(spread_evenly(0, FARTHER, DRAWN)),
        near_gap=branch_errors(near, method.draw(near)).unflatten(0, (ASKED, REPEATS)).mean(1),
    )

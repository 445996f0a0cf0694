"""One training for every method: the same number of steps, batch and schedule."""

from __future__ import annotations

import torch
from torch import Tensor

from ...progress import Job, Progress
from .methods import Network

BATCH = 64
LEARNING_RATE = 3e-3


def train(network: Network, x: Tensor, y: Tensor, steps: int, name: str) -> Job[None]:
    """AdamW with a cosine schedule on batches of the pairs x [N, 1], y [N, POINTS], drawn with torch's random numbers."""
    optimiser = torch.optim.AdamW(network.parameters(), lr=LEARNING_RATE, weight_decay=1e-4, fused=True)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
    network.train()
    for step in range(steps):
        chosen = torch.randint(len(x), (BATCH,))
        loss = network.loss(x[chosen], y[chosen])
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        optimiser.step()
        schedule.step()
        if step % 100 == 0:
            yield Progress(step / steps, f"{name}: loss {loss.item():.4f}")
    network.eval()

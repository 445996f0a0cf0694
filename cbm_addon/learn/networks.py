"""The networks: a regressor for stage 1 and codebook matching (Starke et al. 2024, section 3) for stage 2."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F


def mlp(inputs: int, hidden: int, outputs: int, dropout: float) -> nn.Sequential:
    """Two hidden layers with ELU (section 5 of the paper); dropout on the hidden units."""
    return nn.Sequential(
        nn.Linear(inputs, hidden), nn.ELU(), nn.Dropout(dropout),
        nn.Linear(hidden, hidden), nn.ELU(), nn.Dropout(dropout),
        nn.Linear(hidden, outputs),
    )  # fmt: skip


def sample_codes(logits: Tensor) -> Tensor:
    """One-hot codes [N, C, D] drawn from logits [N, C, D] by the Gumbel trick, with the straight-through gradient of the softmax."""
    gumbel = -torch.empty_like(logits).exponential_().log()
    soft = F.softmax(logits + gumbel, dim=-1)
    hard = F.one_hot(soft.argmax(-1), logits.shape[-1]).to(soft.dtype)
    return hard + soft - soft.detach()


def matching_loss(kind: str, encoder: Tensor, estimator: Tensor) -> Tensor:
    """How far the estimator's distributions are from the encoder's, logits [N, C, D]; both sides are trained.

    kl             KL(encoder || estimator) in nats, summed over channels, plus a tenth of the encoder's entropy so that channels without
                   use settle on one class
    probabilities  squared difference of the probabilities, summed over channels
    paper          squared difference of two independent one-hot samples (eq. 3 as released), averaged
    """
    if kind == "paper":
        return F.mse_loss(sample_codes(estimator), sample_codes(encoder))
    if kind == "probabilities":
        return (F.softmax(encoder, -1) - F.softmax(estimator, -1)).square().sum((-1, -2)).mean()
    log_q, log_p = F.log_softmax(encoder, -1), F.log_softmax(estimator, -1)
    q = log_q.exp()
    return (q * (log_q - log_p)).sum((-1, -2)).mean() - 0.1 * (q * log_q).sum((-1, -2)).mean()


class CodebookMatching(nn.Module):
    """Encoder (y, x -> code), estimator (x -> code) and decoder (code, x -> y), all on normalised features.

    The decoder also sees x, thinned by dropout: it then decodes any sampled code to a coherent sequence.
    """

    def __init__(self, inputs: int, outputs: int, channels: int, classes: int, hidden: int, dropout: float) -> None:
        super().__init__()
        self.channels, self.classes = channels, classes
        codes = channels * classes
        self.encoder = mlp(outputs + inputs, hidden, codes, dropout)
        self.estimator = mlp(inputs, hidden, codes, dropout)
        self.decoder = mlp(codes + inputs, hidden, outputs, 0.0)
        self.thin = nn.Dropout(0.25)

    def logits(self, network: nn.Module, x: Tensor) -> Tensor:
        return network(x).float().unflatten(-1, (self.channels, self.classes))

    def decode(self, codes: Tensor, x: Tensor) -> Tensor:
        """Sequences [N, outputs] from codes [N, C, D] and inputs [N, inputs]."""
        return self.decoder(torch.cat((codes.flatten(-2).to(x.dtype), self.thin(x)), -1))

    def losses(self, x: Tensor, y: Tensor, matching: str) -> tuple[Tensor, Tensor]:
        """Reconstruction (eq. 2) and matching (eq. 3)."""
        encoder = self.logits(self.encoder, torch.cat((y, x), -1))
        estimator = self.logits(self.estimator, x)
        reconstruction = F.mse_loss(self.decode(sample_codes(encoder), x).float(), y)
        return reconstruction, matching_loss(matching, encoder, estimator)

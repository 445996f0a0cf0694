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


class Block(nn.Module):
    """A residual step on hidden units: normalise, linear, ELU, linear, add."""

    def __init__(self, hidden: int, dropout: float) -> None:
        super().__init__()
        self.step = nn.Sequential(nn.LayerNorm(hidden), nn.Linear(hidden, hidden), nn.ELU(), nn.Dropout(dropout), nn.Linear(hidden, hidden))

    def forward(self, x: Tensor) -> Tensor:
        return x + self.step(x)


def trunk(inputs: int, hidden: int, blocks: int, dropout: float) -> nn.Sequential:
    """Inputs to hidden features: a linear layer, residual blocks, normalised at the end."""
    return nn.Sequential(nn.Linear(inputs, hidden), *(Block(hidden, dropout) for _ in range(blocks)), nn.LayerNorm(hidden))


def network(inputs: int, hidden: int, outputs: int, blocks: int, dropout: float) -> nn.Sequential:
    """A trunk and a linear layer; with 0 blocks the paper's `mlp`."""
    return nn.Sequential(*trunk(inputs, hidden, blocks, dropout), nn.Linear(hidden, outputs)) if blocks else mlp(inputs, hidden, outputs, dropout)


def sample_codes(logits: Tensor) -> Tensor:
    """One-hot codes [N, C, D] drawn from logits [N, C, D] by the Gumbel trick, with the straight-through gradient of the softmax."""
    gumbel = -torch.empty_like(logits).exponential_().log()
    soft = F.softmax(logits + gumbel, dim=-1)
    hard = F.one_hot(soft.argmax(-1), logits.shape[-1]).to(soft.dtype)
    return hard + soft - soft.detach()


def likeliest_codes(logits: Tensor) -> Tensor:
    """The likeliest class of each channel, one-hot [N, C, D], with the straight-through gradient of the softmax."""
    soft = F.softmax(logits, dim=-1)
    return F.one_hot(soft.argmax(-1), logits.shape[-1]).to(soft.dtype) + soft - soft.detach()


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


def mean_error(predicted: Tensor, truth: Tensor, importance: Tensor | float = 1.0) -> Tensor:
    """Mean squared error of features [N, outputs]; `importance` [outputs] says how much each number counts, 1 on average."""
    return ((predicted.float() - truth).square() * importance).mean()


class CodebookMatching(nn.Module):
    """Encoder (y, x -> code), estimator (x -> code) and decoder (code, x -> y), all on normalised features.

    The decoder also sees x, thinned by dropout: it then decodes any sampled code to a coherent sequence. Where x are the features of a
    trunk already, one linear layer is estimator enough (`linear`).
    """

    def __init__(self, inputs: int, outputs: int, channels: int, classes: int, hidden: int, dropout: float, blocks: int = 0, linear: bool = False) -> None:
        super().__init__()
        self.channels, self.classes = channels, classes
        codes = channels * classes
        self.encoder = network(outputs + inputs, hidden, codes, blocks, dropout)
        self.estimator = nn.Sequential(nn.Linear(inputs, codes)) if linear else network(inputs, hidden, codes, blocks, dropout)
        self.decoder = network(codes + inputs, hidden, outputs, blocks, 0.0)
        self.thin: nn.Module = nn.Dropout(0.25)
        self.sampled = self.end_to_end = True

    def logits(self, network: nn.Module, x: Tensor) -> Tensor:
        return network(x).float().unflatten(-1, (self.channels, self.classes))

    def decode(self, codes: Tensor, x: Tensor) -> Tensor:
        """Sequences [N, outputs] from codes [N, C, D] and inputs [N, inputs]."""
        return self.decoder(torch.cat((codes.flatten(-2).to(x.dtype), self.thin(x)), -1))

    def losses(self, x: Tensor, y: Tensor, matching: str, importance: Tensor | float = 1.0) -> tuple[Tensor, Tensor]:
        """Reconstruction (eq. 2), in which numbers count by `importance`, and matching (eq. 3).

        The ablations of the paper's table 5: not `sampled`, the likeliest code is decoded; not `end_to_end`, the encoder does not feel the
        matching.
        """
        encoder = self.logits(self.encoder, torch.cat((y, x), -1))
        estimator = self.logits(self.estimator, x)
        codes = sample_codes(encoder) if self.sampled else likeliest_codes(encoder)
        reconstruction = mean_error(self.decode(codes, x), y, importance)
        return reconstruction, matching_loss(matching, encoder if self.end_to_end else encoder.detach(), estimator)

    @torch.no_grad()
    def decoder_of_codes(self) -> nn.Sequential:
        """The decoder as it is run: layers over codes and features side by side."""
        if not isinstance(self.thin, Blind):
            return self.decoder
        codes = self.channels * self.classes
        seen = torch.cat((torch.ones(codes), torch.zeros(self.decoder[0].in_features - codes)))
        return after(torch.diag(seen), self.decoder)


class Blind(nn.Module):
    """Zeros in the place of what must not be seen."""

    def forward(self, x: Tensor) -> Tensor:
        return torch.zeros_like(x)


@torch.no_grad()
def after(matrix: Tensor, layers: nn.Sequential, offset: Tensor | None = None) -> nn.Sequential:
    """Layers whose first, linear one takes `matrix` @ input (+ offset) instead of the input."""
    first: nn.Linear = layers[0]
    folded = nn.Linear(matrix.shape[1], first.out_features)
    folded.weight.copy_(first.weight @ matrix)
    folded.bias.copy_(first.bias if offset is None else first.bias + first.weight @ offset)
    return nn.Sequential(folded, *list(layers)[1:])

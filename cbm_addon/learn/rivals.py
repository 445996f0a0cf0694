"""What codebook matching is compared with, in its place (Starke et al. 2024, tables 2 and 5): all meet the solver as codes and a decoder.

A regressor needs nothing of its own: it is codebook matching with one channel of one class.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from .networks import after, mean_error, network

DIMENSIONS = 32  # of the Gaussian latent
QUANTILES = 32  # classes by which the solver draws one of its numbers


class ConditionalVae(nn.Module):
    """A conditional variational auto-encoder: encoder (y, x -> Gaussian) and decoder (z, x -> y), with a standard normal prior.

    The solver draws it by codes: class i of a channel stands for the i-th quantile of a normal distribution, and all classes are as likely.
    """

    def __init__(self, inputs: int, outputs: int, hidden: int, dropout: float, blocks: int) -> None:
        super().__init__()
        self.channels, self.classes = DIMENSIONS, QUANTILES
        self.encoder = network(outputs + inputs, hidden, 2 * DIMENSIONS, blocks, dropout)
        self.decoder = network(DIMENSIONS + inputs, hidden, outputs, blocks, 0.0)
        quantiles = torch.distributions.Normal(0, 1).icdf((torch.arange(QUANTILES) + 0.5) / QUANTILES)
        self.register_buffer("table", torch.kron(torch.eye(DIMENSIONS), quantiles[None]), persistent=False)
        self.estimator = nn.Sequential(nn.Linear(inputs, DIMENSIONS * QUANTILES)).requires_grad_(False)
        nn.init.zeros_(self.estimator[0].weight)
        nn.init.zeros_(self.estimator[0].bias)

    def logits(self, module: nn.Module, x: Tensor) -> Tensor:
        return module(x).float().unflatten(-1, (self.channels, self.classes))

    def decode(self, codes: Tensor, x: Tensor) -> Tensor:
        return self.decoder(torch.cat((codes.flatten(-2).to(x.dtype) @ self.table.T.to(x.dtype), x), -1))

    def losses(self, x: Tensor, y: Tensor, matching: str, importance: Tensor | float = 1.0) -> tuple[Tensor, Tensor]:
        """Reconstruction, and the divergence from the prior in nats."""
        mean, log_variance = self.encoder(torch.cat((y, x), -1)).float().chunk(2, -1)
        z = mean + torch.randn_like(mean) * (0.5 * log_variance).exp()
        divergence = 0.5 * (mean.square() + log_variance.exp() - 1 - log_variance).sum(-1).mean()
        return mean_error(self.decoder(torch.cat((z.to(x.dtype), x), -1)), y, importance), divergence

    @torch.no_grad()
    def decoder_of_codes(self) -> nn.Sequential:
        return after(torch.block_diag(self.table, torch.eye(self.decoder[0].in_features - DIMENSIONS)), self.decoder)


class ContinuousMatching(nn.Module):
    """Codebook matching without a codebook: encoder and estimator meet in a continuous latent of C * D numbers. There is one answer."""

    def __init__(self, inputs: int, outputs: int, size: int, hidden: int, dropout: float, blocks: int) -> None:
        super().__init__()
        self.channels = self.classes = 1
        self.encoder = network(outputs + inputs, hidden, size, blocks, dropout)
        self.match = nn.Sequential(nn.Linear(inputs, size))
        self.estimator = nn.Sequential(nn.Linear(inputs, 1)).requires_grad_(False)
        self.decoder = network(size + inputs, hidden, outputs, blocks, 0.0)

    def logits(self, module: nn.Module, x: Tensor) -> Tensor:
        return module(x).float().unflatten(-1, (1, 1))

    def decode(self, codes: Tensor, x: Tensor) -> Tensor:
        return self.decoder(torch.cat((self.match(x), x), -1))

    def losses(self, x: Tensor, y: Tensor, matching: str, importance: Tensor | float = 1.0) -> tuple[Tensor, Tensor]:
        """Reconstruction, and the squared distance of the latents, whose size is fixed so that it cannot be had by shrinking them."""
        latent = F.layer_norm(self.encoder(torch.cat((y, x), -1)).float(), (self.encoder[-1].out_features,))
        distance = (latent - self.match(x).float()).square().sum(-1).mean()
        return mean_error(self.decoder(torch.cat((latent.to(x.dtype), x), -1)), y, importance), distance

    @torch.no_grad()
    def decoder_of_codes(self) -> nn.Sequential:
        first: nn.Linear = self.match[0]
        inputs = first.in_features
        matrix = torch.cat((torch.zeros(first.out_features + inputs, 1), torch.cat((first.weight, torch.eye(inputs)))), 1)
        return after(matrix, self.decoder, torch.cat((first.bias, torch.zeros(inputs))))

"""The methods that the appendix compares: three that map X to Y directly, three that are informed about how Y is distributed.

All of them learn the same pairs; the networks have the same hidden layers (`mlp`, the paper's blocks) and the same training.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Protocol

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from ...learn.networks import Blind, CodebookMatching, mlp, sample_codes
from ...learn.rivals import DIMENSIONS, ConditionalVae
from .function import POINTS

HIDDEN = 64
LATENT = 4  # numbers of a continuous latent
CHANNELS, CLASSES = 8, 8  # of a discrete latent


class Method(Protocol):
    """What has learned; both may use torch's random numbers."""

    def draw(self, x: Tensor) -> Tensor:
        """One answer to each x: [N, 1] -> [N, POINTS]."""
        ...

    def rebuild(self, x: Tensor, y: Tensor) -> Tensor:
        """Sequences [N, POINTS] as they come back when the method is shown them, if it can be."""
        ...


class Network(nn.Module, ABC):
    """A method that is trained."""

    @abstractmethod
    def loss(self, x: Tensor, y: Tensor) -> Tensor:
        """What training lowers, for a batch of pairs."""

    @abstractmethod
    def draw(self, x: Tensor) -> Tensor:
        """One answer to each x: [N, 1] -> [N, POINTS]."""

    def rebuild(self, x: Tensor, y: Tensor) -> Tensor:
        """A method that maps X to Y directly cannot be shown y."""
        return self.draw(x)


class Regressor(Network):
    """MLP: X → Y."""

    def __init__(self) -> None:
        super().__init__()
        self.network = mlp(1, HIDDEN, POINTS, 0.0)

    def loss(self, x: Tensor, y: Tensor) -> Tensor:
        return F.mse_loss(self.network(x), y)

    def draw(self, x: Tensor) -> Tensor:
        return self.network(x)


class Vae(Network):
    """VAE: X → a Gaussian → Y. What it encodes is X, as in the paper: the latent can spread, but knows of no sign."""

    def __init__(self, weight: float) -> None:
        super().__init__()
        self.weight = weight
        self.encoder, self.decoder = mlp(1, HIDDEN, 2 * LATENT, 0.0), mlp(LATENT, HIDDEN, POINTS, 0.0)

    def loss(self, x: Tensor, y: Tensor) -> Tensor:
        mean, log_variance = self.encoder(x).chunk(2, -1)
        return F.mse_loss(self.decoder(_gaussian(mean, log_variance)), y) + self.weight * _divergence(mean, log_variance)

    def draw(self, x: Tensor) -> Tensor:
        return self.decoder(_gaussian(*self.encoder(x).chunk(2, -1)))


class Vq(Network):
    """VQ: X → the nearest vectors of a codebook, one per channel → Y (van den Oord et al. 2017)."""

    def __init__(self) -> None:
        super().__init__()
        self.encoder, self.decoder = mlp(1, HIDDEN, CHANNELS * LATENT, 0.0), mlp(CHANNELS * LATENT, HIDDEN, POINTS, 0.0)
        self.codebook = nn.Parameter(torch.randn(CHANNELS, CLASSES, LATENT))

    def quantise(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Encoded x and the vectors nearest to it, both [N, CHANNELS, LATENT]."""
        encoded = self.encoder(x).unflatten(-1, (CHANNELS, LATENT))
        nearest = (encoded[:, :, None] - self.codebook).square().sum(-1).argmin(-1)
        return encoded, self.codebook[torch.arange(CHANNELS), nearest]

    def loss(self, x: Tensor, y: Tensor) -> Tensor:
        encoded, nearest = self.quantise(x)
        passed = encoded + (nearest - encoded).detach()
        commitment = F.mse_loss(nearest, encoded.detach()) + 0.25 * F.mse_loss(encoded, nearest.detach())
        return F.mse_loss(self.decoder(passed.flatten(-2)), y) + commitment

    def draw(self, x: Tensor) -> Tensor:
        return self.decoder(self.quantise(x)[1].flatten(-2))


class Cvae(Network):
    """CVAE: (Y, X) → a Gaussian, (Gaussian, X) → Y; answers are drawn from the standard Gaussian. The networks are those of the model's rival."""

    def __init__(self, weight: float) -> None:
        super().__init__()
        self.weight = weight
        self.network = ConditionalVae(inputs=1, outputs=POINTS, hidden=HIDDEN, dropout=0.0, blocks=0)

    def loss(self, x: Tensor, y: Tensor) -> Tensor:
        reconstruction, divergence = self.network.losses(x, y, "")
        return reconstruction + self.weight * divergence

    def draw(self, x: Tensor) -> Tensor:
        return self.network.decoder(torch.cat((torch.randn(len(x), DIMENSIONS), x), -1))

    def rebuild(self, x: Tensor, y: Tensor) -> Tensor:
        latent = _gaussian(*self.network.encoder(torch.cat((y, x), -1)).chunk(2, -1))
        return self.network.decoder(torch.cat((latent, x), -1))


class Matching(Network):
    """Codebook matching with the networks and losses that train the model."""

    def __init__(self, kind: str, weight: float, sees_x: bool) -> None:
        super().__init__()
        self.kind, self.weight = kind, weight
        self.network = CodebookMatching(inputs=1, outputs=POINTS, channels=CHANNELS, classes=CLASSES, hidden=HIDDEN, dropout=0.0)
        # Thinning is for inputs of many numbers; of a single one the decoder sees all or nothing.
        self.network.thin = nn.Identity() if sees_x else Blind()

    def loss(self, x: Tensor, y: Tensor) -> Tensor:
        reconstruction, matching = self.network.losses(x, y, self.kind)
        return reconstruction + self.weight * matching

    def draw(self, x: Tensor) -> Tensor:
        return self.network.decode(sample_codes(self.network.logits(self.network.estimator, x)), x)

    def rebuild(self, x: Tensor, y: Tensor) -> Tensor:
        return self.network.decode(sample_codes(self.network.logits(self.network.encoder, torch.cat((y, x), -1))), x)


class Database:
    """Database search: the stored pair whose X is nearest, with either of its signs."""

    def __init__(self, x: Tensor, y: Tensor) -> None:
        """Pairs x [2 N, 1] in rising order and y [2 N, POINTS], the signs of one x side by side."""
        self.keys, self.branches = x[::2, 0].contiguous(), y.unflatten(0, (-1, 2))

    def nearest(self, x: Tensor) -> Tensor:
        """Both stored sequences [N, 2, POINTS] of the nearest key."""
        right = torch.searchsorted(self.keys, x[:, 0].contiguous()).clamp(1, len(self.keys) - 1)
        left_is_nearer = x[:, 0] - self.keys[right - 1] < self.keys[right] - x[:, 0]
        return self.branches[right - left_is_nearer.long()]

    def draw(self, x: Tensor) -> Tensor:
        return self.nearest(x)[torch.arange(len(x)), torch.randint(2, (len(x),))]

    def rebuild(self, x: Tensor, y: Tensor) -> Tensor:
        both = self.nearest(x)
        return both[torch.arange(len(x)), (both - y[:, None]).square().sum(-1).argmin(-1)]


def _gaussian(mean: Tensor, log_variance: Tensor) -> Tensor:
    return mean + torch.randn_like(mean) * (log_variance / 2).exp()


def _divergence(mean: Tensor, log_variance: Tensor) -> Tensor:
    """KL divergence from the standard Gaussian in nats, summed over the latent."""
    return 0.5 * (mean.square() + log_variance.exp() - 1 - log_variance).sum(-1).mean()

"""The learned parts: residual U-Net, depth encoder, and the two kernel generators.

No layer normalises over a picture: every pixel would then depend on the whole scene, which breaks local
equivariance.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Self, cast

import torch
import torch.nn.functional as F
from e2cnn import gspaces
from e2cnn import nn as enn
from torch import nn
from typing_extensions import override

from gem_lite.se2 import CELLS_MULTIPLE
from gem_lite.steerable import disc


class Pointwise(nn.Conv2d):
    """A 1 x 1 convolution, computed as a product of matrices: on a CPU, that is several times faster.

    The pictures should be in the memory format "channels last".
    """

    def __init__(self, inputs: int, outputs: int, stride: int = 1) -> None:
        super().__init__(inputs, outputs, 1, stride=stride)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(B, inputs, H, W) to (B, outputs, H / stride, W / stride)."""
        rows, cols = self.stride
        pixels = x[..., ::rows, ::cols].permute(0, 2, 3, 1)
        return F.linear(pixels, self.weight.flatten(1), self.bias).permute(0, 3, 1, 2)


class ResidualBlock(nn.Module):
    """Two 3 x 3 convolutions beside a 1 x 1 shortcut. The second starts at 0, so the block starts as its shortcut."""

    def __init__(self, inputs: int, outputs: int, stride: int = 1) -> None:
        super().__init__()
        self.first = nn.Conv2d(inputs, outputs, 3, stride=stride, padding=1)
        self.second = nn.Conv2d(outputs, outputs, 3, padding=1)
        self.shortcut = Pointwise(inputs, outputs, stride)
        nn.init.zeros_(self.second.weight)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(B, inputs, H, W) to (B, outputs, H / stride, W / stride)."""
        # In place: less memory is written. The gradient of a ReLU needs its result only.
        inner = F.relu(self.first(x), inplace=True)
        return F.relu(self.second(inner).add_(self.shortcut(x)), inplace=True)


class UNet(nn.Module):
    """The vision-language encoder A (Fig. 3): eight residual blocks, language at the bottleneck.

    Four blocks with max-pooling each halve the picture; four with bilinear upsampling each double it. The language
    vector is joined to every pixel of the bottleneck, or left out if ``language_dim`` is None. H and W must be
    multiples of 16.

    Args:
        joins: at how many levels the language is joined, from the bottleneck upwards.
    """

    def __init__(
        self, inputs: int, outputs: int, language_dim: int | None, widths: Sequence[int], joins: int = 1
    ) -> None:
        super().__init__()
        ins = [inputs, *widths[:-1]]
        self.down = nn.ModuleList(ResidualBlock(i, o) for i, o in zip(ins, widths, strict=True))
        self.language = None if language_dim is None else nn.Linear(language_dim, widths[-1])
        joined = (1 if language_dim is None else 2) * widths[-1]
        self.bottleneck = nn.Conv2d(joined, widths[-1], 1)
        ups = decoder_widths(widths)
        below = [widths[-1], *ups[:-1]]
        above = [] if language_dim is None else [nn.Linear(language_dim, widths[-1]) for _ in range(joins - 1)]
        self.language_above = nn.ModuleList(above)
        words = [widths[-1]] * len(above) + [0] * (len(ups) - len(above))
        self.up = nn.ModuleList(
            ResidualBlock(b + skip + w, o) for b, skip, w, o in zip(below, reversed(widths), words, ups, strict=True)
        )
        self.out = Pointwise(widths[0], outputs)

    def decode(self, x: torch.Tensor, language: torch.Tensor | None = None) -> list[torch.Tensor]:
        """The output of each upsampling block, (B, decoder_widths[i], H / 2^(3-i), W / 2^(3-i))."""
        if x.shape[-1] % CELLS_MULTIPLE or x.shape[-2] % CELLS_MULTIPLE:
            raise ValueError(f"height and width must be multiples of {CELLS_MULTIPLE}, got {tuple(x.shape[-2:])}")
        skips = []
        for block in self.down:
            skips.append(block(x))
            x = F.max_pool2d(skips[-1], 2)

        def join(layer: nn.Module, x: torch.Tensor) -> torch.Tensor:
            return torch.cat([x, layer(language)[:, :, None, None].expand(-1, -1, *x.shape[-2:])], dim=1)

        if self.language is not None:
            x = join(self.language, x)
        x = F.relu(self.bottleneck(x))
        levels = []
        for level, block in enumerate(self.up):
            x = F.interpolate(x, scale_factor=2, mode="bilinear", align_corners=False)
            x = torch.cat([x, skips.pop()], dim=1)
            if level < len(self.language_above):
                x = join(self.language_above[level], x)
            x = block(x)
            levels.append(x)
        return levels

    def forward(self, x: torch.Tensor, language: torch.Tensor | None = None) -> torch.Tensor:
        """``x`` (B, inputs, H, W), ``language`` (B, D) to (B, outputs, H, W)."""
        return self.out(self.decode(x, language)[-1])


def decoder_widths(widths: Sequence[int]) -> list[int]:
    """Channels of the four upsampling blocks of a `UNet`, from H / 8 to H."""
    return [*reversed(widths[:-1]), widths[0]]


class SemanticRefiner(nn.Module):
    """Eq. 4's f_theta: a two-layer depth encoder joined to the raw map, then one linear layer per pixel.

    Args:
        channels: of M.
        depth_features: channels of the depth encoder.
        encoder: another depth encoder with so many channels, instead of the paper's.
    """

    def __init__(self, channels: int, depth_features: int = 8, encoder: nn.Module | None = None) -> None:
        super().__init__()
        self.encoder = encoder or nn.Sequential(
            nn.Conv2d(1, depth_features, 3, padding=1),
            nn.ReLU(),
            nn.Conv2d(depth_features, depth_features, 3, padding=1),
            nn.ReLU(),
        )
        self.linear = Pointwise(1 + depth_features, channels)
        # The output starts as nearly the raw map, so that learning begins from CLIP's map.
        nn.init.normal_(self.linear.weight, std=0.02)
        nn.init.ones_(self.linear.weight[:, :1])
        nn.init.zeros_(cast(torch.Tensor, self.linear.bias))

    def forward(self, raw: torch.Tensor, height: torch.Tensor) -> torch.Tensor:
        """``raw`` and ``height`` (B, 1, H, W) to M (B, channels, H, W)."""
        return self.linear(torch.cat([raw, self.encoder(height)], dim=1))


def set_padding(module: nn.Module, continued: bool) -> None:
    """Let a module's convolutions see the border of a picture again beyond it, if ``continued``; otherwise zeros."""
    for layer in module.modules():
        if isinstance(layer, nn.Conv2d):
            layer.padding_mode = "replicate" if continued else "zeros"


class LanguageKernel(nn.Module):
    """psi(language): a small U-Net from the expanded language vector to a kernel (A.1.2).

    Two coordinate channels are joined to the language: a convolution cannot tell the pixels of a constant picture
    apart. Strided layers keep odd sizes centred (17, 9, 5).
    """

    def __init__(self, size: int, channels: int, language_dim: int, widths: Sequence[int]) -> None:
        super().__init__()
        self.size = size
        axis = torch.linspace(-1, 1, size)
        self.coordinates: torch.Tensor
        self.register_buffer("coordinates", torch.stack(torch.meshgrid(axis, axis, indexing="ij"))[None])
        self.language = nn.Linear(language_dim, widths[0])
        self.first = ResidualBlock(widths[0] + 2, widths[0])
        self.down = nn.ModuleList(ResidualBlock(i, o, stride=2) for i, o in pairwise(widths))
        self.up = nn.ModuleList(ResidualBlock(o + i, i) for o, i in pairwise(reversed(widths)))
        self.out = nn.Conv2d(widths[0], channels, 1)

    def forward(self, language: torch.Tensor) -> torch.Tensor:
        """(B, D) to (B, channels, size, size)."""
        batch = len(language)
        words = self.language(language)[:, :, None, None].expand(-1, -1, self.size, self.size)
        x = self.first(torch.cat([words, self.coordinates.expand(batch, -1, -1, -1)], dim=1))
        skips = []
        for block in self.down:
            skips.append(x)
            x = block(x)
        for block in self.up:
            skip = skips.pop()
            x = F.interpolate(x, size=skip.shape[-2:], mode="bilinear", align_corners=True)
            x = block(torch.cat([x, skip], dim=1))
        return self.out(x) / self.size


class CropKernel(nn.Module):
    """psi(crop): rotation-equivariant layers of e2cnn from an unrotated crop to a kernel (Fig. A3).

    Input and output are trivial fields, so turning the crop turns the kernel: psi(T_g c) = T_g psi(c),
    exactly for quarter turns and up to interpolation for the rest of C_8. Only the crop's disc is read, since a turn
    moves its corners out of the picture.
    """

    def __init__(self, inputs: int, channels: int, fields: int) -> None:
        super().__init__()
        self._sizes = inputs, channels, fields
        space = gspaces.Rot2dOnR2(N=8)
        self._input = enn.FieldType(space, inputs * [space.trivial_repr])
        hidden = enn.FieldType(space, fields * [space.regular_repr])
        output = enn.FieldType(space, channels * [space.trivial_repr])
        layers: list[nn.Module] = []
        previous = self._input
        with warnings.catch_warnings():
            # e2cnn 0.2.3 indexes with uint8 masks, which torch still allows.
            warnings.simplefilter("ignore")
            for _ in range(3):
                layers += [FieldConvolution(previous, hidden, 5), enn.ReLU(hidden, inplace=True)]
                previous = hidden
            self.layers = enn.SequentialModule(*layers, FieldConvolution(hidden, output, 5))

    def forward(self, crop: torch.Tensor) -> torch.Tensor:
        """(B, inputs, h, h) to (B, channels, h, h)."""
        size = crop.shape[-1]
        return self.layers(enn.GeometricTensor(crop * disc(size).to(crop), self._input)).tensor / size

    def __reduce__(self) -> tuple:
        return rebuild, (type(self), self._sizes, dict(self.named_parameters()), self.training)


class FieldConvolution(enn.R2Conv):
    """e2cnn's convolution of fields, with bases of its own and one state dict for both modes.

    Without bases of its own, all models would share e2cnn's, and `to` would change them for all. In the mode of
    evaluation, e2cnn keeps the filter that it makes from the weights; this is no state.
    """

    def __init__(self, inputs: enn.FieldType, outputs: enn.FieldType, size: int) -> None:
        super().__init__(inputs, outputs, size, padding=size // 2, recompute=True)
        self.register_load_state_dict_post_hook(_expand_again)

    @override
    def train(self, mode: bool = True) -> Self:
        super().train(mode)
        for name in ("filter", "expanded_bias"):
            if hasattr(self, name):
                value = getattr(self, name)
                delattr(self, name)
                self.register_buffer(name, value, persistent=False)
        return self


def _expand_again(layer: nn.Module, _: object) -> None:
    """After a layer got other weights, let it make its filter from them."""
    if not layer.training:
        with torch.no_grad():
            layer.train().eval()


def rebuild(
    kind: Callable[..., nn.Module], sizes: tuple, weights: dict[str, nn.Parameter], training: bool
) -> nn.Module:  # fmt: skip
    """A copy of a module that holds objects of e2cnn, which cannot be pickled: made anew, with these weights."""
    with torch.random.fork_rng(devices=[]):
        module = kind(*sizes).to(next(iter(weights.values())))
    for name, weight in weights.items():
        layer, _, own = name.rpartition(".")
        setattr(module.get_submodule(layer), own, weight)
    with torch.no_grad():
        return module.train(training)


def parameter_count(module: nn.Module) -> int:
    """The number of trainable parameters."""
    return sum(math.prod(p.shape) for p in module.parameters() if p.requires_grad)

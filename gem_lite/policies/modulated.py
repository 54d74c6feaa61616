"""Two more encoders: words act on every level of the decoder by multiplication; one also commutes with rotations.

The paper's encoder is a plain U-Net (`networks.UNet`) that joins the words at its bottleneck. Nothing ties what it sees
of a scene to what it sees of the turned scene (A.9.2), and the two sides of a thing, one the mirror image of the other,
it learns to tell apart only slowly. Here the words scale and shift the features of every level, and the layers may
commute with the turns of C_n: then a *regular field* holds n numbers at each pixel, one for each turn by 2 pi r / n. If
the picture turns by 2 pi / n, the fields turn with it, and each field's numbers move on by one. ReLU acts on each
number alone, pooling and upsampling keep the picture's centre, words act on whole fields, and the mean over the n
numbers at the end no longer knows the turn: the output is one number a channel and pixel, which turns with the picture.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from itertools import pairwise

import torch
import torch.nn.functional as F
from e2cnn import gspaces
from e2cnn import nn as enn
from torch import nn

from gem_lite.policies.networks import FieldConvolution, decoder_widths, rebuild
from gem_lite.se2 import CELLS_MULTIPLE


class RegularConvolution(nn.Module):
    """A 3 x 3 convolution from regular fields, or from a plain picture, to regular fields of C_n.

    Args:
        inputs, outputs: numbers of fields; of channels, if the input is a plain picture.
        rotations: n.
        plain: whether the input is a plain picture.
    """

    def __init__(self, inputs: int, outputs: int, rotations: int, plain: bool) -> None:
        super().__init__()
        space = gspaces.Rot2dOnR2(N=rotations)
        self._sizes = inputs, outputs, rotations, plain
        self._input = enn.FieldType(space, inputs * [space.trivial_repr if plain else space.regular_repr])
        output = enn.FieldType(space, outputs * [space.regular_repr])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # see `networks.CropKernel`
            self.layer = FieldConvolution(self._input, output, 3)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(B, inputs or inputs * n, H, W) to (B, outputs * n, H, W)."""
        return self.layer(enn.GeometricTensor(x, self._input)).tensor

    def __reduce__(self) -> tuple:
        return rebuild, (type(self), self._sizes, dict(self.named_parameters()), self.training)


def mean_of_fields(x: torch.Tensor, rotations: int) -> torch.Tensor:
    """(B, fields * n, H, W) to (B, fields, H, W): what no longer knows the turn."""
    return x.unflatten(1, (-1, rotations)).mean(dim=2)


class DepthFields(nn.Module):
    """The two-layer depth encoder of Eq. 4 with regular fields: its features turn with the heights.

    Args:
        fields: number of fields, and of features.
        rotations: n.
    """

    def __init__(self, fields: int, rotations: int) -> None:
        super().__init__()
        self.rotations = rotations
        self.layers = nn.Sequential(
            RegularConvolution(1, fields, rotations, plain=True),
            nn.ReLU(),
            RegularConvolution(fields, fields, rotations, plain=False),
            nn.ReLU(),
        )

    def forward(self, height: torch.Tensor) -> torch.Tensor:
        """(B, 1, H, W) to (B, fields, H, W)."""
        return mean_of_fields(self.layers(height), self.rotations)


class ModulatedUNet(nn.Module):
    """An encoder with four levels, as `networks.UNet`; the words scale and shift each field of the decoder.

    Args:
        inputs, outputs: channels of the picture and of the features.
        language_dim: D, or None for an encoder without words.
        widths: channels of the four levels. Each field has ``rotations`` of them.
        rotations: n; 1 for ordinary convolutions, whose fields are channels.

    Raises:
        ValueError: widths that are no multiples of n; a picture whose sides are no multiples of 16.
    """

    def __init__(
        self, inputs: int, outputs: int, language_dim: int | None, widths: Sequence[int], rotations: int
    ) -> None:
        super().__init__()
        if any(width % rotations for width in widths):
            raise ValueError(f"widths must be multiples of {rotations}, one for each rotation, got {tuple(widths)}")
        self.rotations = rotations
        fields = [width // rotations for width in widths]
        ups = decoder_widths(fields)
        below = [fields[-1], *ups[:-1]]
        joined = [b + skip for b, skip in zip(below, reversed(fields), strict=True)]
        self.down = nn.ModuleList([self._block(inputs, fields[0], plain=True)])
        self.down.extend(self._block(i, o) for i, o in pairwise(fields))
        self.bottleneck = self._layer(fields[-1], fields[-1])
        self.up = nn.ModuleList(self._block(i, o) for i, o in zip(joined, ups, strict=True))
        self.words = nn.ModuleList(nn.Linear(language_dim, 2 * o) for o in ups) if language_dim else None
        self.out = nn.Linear(fields[0], outputs)

    def _layer(self, inputs: int, outputs: int, plain: bool = False) -> nn.Module:
        if self.rotations == 1:
            return nn.Conv2d(inputs, outputs, 3, padding=1)
        return RegularConvolution(inputs, outputs, self.rotations, plain)

    def _block(self, inputs: int, outputs: int, plain: bool = False) -> nn.Module:
        first, second = self._layer(inputs, outputs, plain), self._layer(outputs, outputs)
        return nn.Sequential(first, nn.ReLU(inplace=True), second, nn.ReLU(inplace=True))

    def forward(self, x: torch.Tensor, language: torch.Tensor | None = None) -> torch.Tensor:
        """``x`` (B, inputs, H, W), ``language`` (B, D) to (B, outputs, H, W)."""
        if x.shape[-1] % CELLS_MULTIPLE or x.shape[-2] % CELLS_MULTIPLE:
            raise ValueError(f"height and width must be multiples of {CELLS_MULTIPLE}, got {tuple(x.shape[-2:])}")
        skips = []
        for block in self.down:
            skips.append(block(x))
            x = F.avg_pool2d(skips[-1], 2)
        x = F.relu(self.bottleneck(x))
        for level, block in enumerate(self.up):
            x = F.interpolate(x, scale_factor=2, mode="bilinear", align_corners=False)
            x = block(torch.cat([x, skips.pop()], dim=1))
            if self.words is not None:
                of_fields = self.words[level](language).repeat_interleave(self.rotations, dim=1)[:, :, None, None]
                scale, shift = of_fields.chunk(2, dim=1)
                x = x * (1 + scale) + shift
        return self.out(mean_of_fields(x, self.rotations).permute(0, 2, 3, 1)).permute(0, 3, 1, 2)

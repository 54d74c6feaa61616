"""The embedded CLIP's architecture: transformers' dual encoder with a residual convolutional image tower."""

from __future__ import annotations

from typing import Any

import torch
import torch.nn.functional as F
from torch import nn
from torch.nn.utils.fusion import fuse_conv_bn_eval
from transformers import AutoConfig, AutoModel, VisionTextDualEncoderConfig, VisionTextDualEncoderModel


class ResNetClipConfig(VisionTextDualEncoderConfig):
    """The configuration of `ResNetClip`."""

    model_type = "gem-lite-resnet-clip"


class ResNetClip(VisionTextDualEncoderModel):
    """`VisionTextDualEncoderModel` as it is, but for two layers without weights of its ResNet.

    The picture is 40 pixels wide: the stem's max pooling is left out, which keeps twice the resolution
    for strokes two pixels wide. The pooled features are flattened, as the projection wants them.
    """

    config_class = ResNetClipConfig
    vision_model: Any  # transformers says of it only that it is a module

    def __init__(self, config: ResNetClipConfig) -> None:
        super().__init__(config)
        self.vision_model.embedder.pooler = nn.Identity()
        self.vision_model.pooler = nn.Sequential(self.vision_model.pooler, nn.Flatten())

    def feature_map(self, pixels: torch.Tensor) -> torch.Tensor:
        """What is pooled and projected to an embedding, before it is: (N, 3, H, W) to (N, h, w, channels).

        A picture of 40 pixels makes three cells of 16, and the tower has learned to see in them its 40
        pixels. Moved by half of what is missing, every cell of a larger picture is about its own 16.
        """
        vision: Any = self.config.vision_config
        shift = -vision.image_size % 2 ** len(vision.depths) // 2
        moved = F.pad(pixels[..., shift:, shift:], (0, shift, 0, shift), mode="replicate")
        return self.vision_model(moved).last_hidden_state.permute(0, 2, 3, 1)

    def fold_batch_norms(self) -> None:
        """Put every batch normalisation into the convolution before it: the same function, faster; for inference."""
        for layer in self.vision_model.modules():
            if isinstance(getattr(layer, "normalization", None), nn.BatchNorm2d):
                layer.convolution = fuse_conv_bn_eval(layer.convolution, layer.normalization)
                layer.normalization = nn.Identity()


AutoConfig.register(ResNetClipConfig.model_type, ResNetClipConfig)
AutoModel.register(ResNetClipConfig, ResNetClip)

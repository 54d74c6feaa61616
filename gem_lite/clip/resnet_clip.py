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
    """`VisionTextDualEncoderModel` with changes in two layers of its ResNet that have no weights.

    The picture is only 40 pixels wide, and strokes are two pixels wide. So the first layers have no max pooling, which
    doubles the resolution. The pooled features are flattened, because the projection needs vectors.
    """

    config_class = ResNetClipConfig
    config: Any
    vision_model: Any  # transformers gives it no other type than Module

    def __init__(self, config: ResNetClipConfig) -> None:
        super().__init__(config)
        self.vision_model.embedder.pooler = nn.Identity()
        self.vision_model.pooler = nn.Sequential(self.vision_model.pooler, nn.Flatten())

    @property
    def stages(self) -> int:
        """The number of the image tower's stages. After stage s, the resolution is 2^s times lower."""
        return len(self.config.vision_config.depths)

    def feature_map(self, pixels: torch.Tensor, stage: int) -> torch.Tensor:
        """The features after a stage of the image tower, before pooling: (N, 3, H, W) to (N, h, w, channels).

        After stage s, one position covers 2^s pixels. In training, a picture had 40 pixels; after the last stage, that
        is three positions (48 pixels): 8 pixels are missing. So a larger picture is shifted by half of them, and every
        position is centred on its own pixels.

        Args:
            stage: from 1 to `stages`.
        """
        shift = -self.config.vision_config.image_size % 2**stage // 2
        x = F.pad(pixels[..., shift:, shift:], (0, shift, 0, shift), mode="replicate")
        x = self.vision_model.embedder(x)
        for layers in self.vision_model.encoder.stages[:stage]:
            x = layers(x)
        return x.permute(0, 2, 3, 1)

    def fold_batch_norms(self) -> None:
        """Merge every batch normalisation into the convolution before it, for faster inference with the same result."""
        for layer in self.vision_model.modules():
            if isinstance(getattr(layer, "normalization", None), nn.BatchNorm2d):
                layer.convolution = fuse_conv_bn_eval(layer.convolution, layer.normalization)
                layer.normalization = nn.Identity()


AutoConfig.register(ResNetClipConfig.model_type, ResNetClipConfig)
AutoModel.register(ResNetClipConfig, ResNetClip)

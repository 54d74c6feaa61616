"""Every number that shapes a policy or its training: `lite` for two CPU cores, `paper` for a GPU."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from gem_lite.se2 import Workspace


@dataclass(frozen=True)
class Config:
    """A configuration. The defaults are `lite`.

    Attributes:
        pixel: size of a height map's cell (m).
        patch, stride: CLIP patches of the side views (pixels of a 480 x 640 view).
        top_patch, top_stride: CLIP patches of the height map (m).
        text_weight, image_weight: w1 and w2 of Eq. 4.
        drop_image_map: how often training hides the image-conditioned map.
        rotations: n, into how many rotations a kernel is lifted.
        frequency: K, the largest Fourier frequency kept.
        angles: how many angles are sampled at the output.
        kernel: h, side of the dynamic kernel (pixels, odd).
        crop: side of the place module's crop at the pick (pixels, odd).
        widths: channels of the U-Net's four levels.
        kernel_widths: channels of the language kernel generator's three levels.
        fields: regular fields of the place kernel generator's layers.
        channels: channels that features and kernels share.
        steps, batch, learning_rate: training.
    """

    name: str = "lite"
    pixel: float = 0.00625
    patch: int = 40
    stride: int = 20
    top_patch: float = 0.125
    top_stride: float = 0.0625
    text_weight: float = 0.8
    image_weight: float = 0.2
    drop_image_map: float = 0.3
    rotations: int = 180
    frequency: int = 8
    angles: int = 36
    kernel: int = 17
    crop: int = 17
    widths: tuple[int, ...] = (16, 24, 32, 48)
    kernel_widths: tuple[int, ...] = (32, 48, 64)
    fields: int = 6
    channels: int = 3
    steps: int = 1500
    batch: int = 2
    learning_rate: float = 1e-3

    @property
    def workspace(self) -> Workspace:
        """The workspace at this configuration's resolution."""
        return Workspace(pixel=self.pixel)

    def as_dict(self) -> dict:
        """As JSON holds it: tuples become lists."""
        return {key: list(value) if isinstance(value, tuple) else value for key, value in asdict(self).items()}

    @classmethod
    def from_dict(cls, values: dict) -> Config:
        """The inverse of `as_dict`. Raises ValueError on names that this version does not know."""
        unknown = set(values) - set(cls.__dataclass_fields__)
        if unknown:
            raise ValueError(f"the configuration has unknown entries {sorted(unknown)}")
        return cls(**{key: tuple(value) if isinstance(value, list) else value for key, value in values.items()})


LITE = Config()
PAPER = Config(
    name="paper",
    pixel=0.003125,
    frequency=16,
    angles=72,
    kernel=33,
    crop=33,
    widths=(32, 64, 128, 256),
    kernel_widths=(64, 128, 256),
    fields=16,
    steps=30_000,
    batch=1,
    learning_rate=1e-4,
)
CONFIGS = {config.name: config for config in (LITE, PAPER)}

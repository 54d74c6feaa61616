"""Methods with small networks, which train in a second."""

import dataclasses

import torch

from gem_lite.policies import methods
from gem_lite.policies.gem_config import LITE

SIZES = {"widths": (8, 8, 8, 8), "kernel_widths": (4, 8, 8), "fields": 2, "rotations": 36, "frequency": 4, "angles": 12}
SMALL = dataclasses.replace(LITE, **SIZES, steps=4, batch=1)


def small(name, /, **changes):
    """A method's configuration with small networks, and changed entries."""
    config = methods.find(name)[1]
    sizes = {key: value for key, value in SIZES.items() if key in config.as_dict()}
    return dataclasses.replace(config, **sizes | changes)


def weights(policy):
    """All weights of a policy, in one vector."""
    return torch.cat([parameter.detach().flatten() for parameter in policy.parameters()])


def disturbed(module):
    """A module in evaluation mode with random weights everywhere, also where training starts from 0."""
    for parameter in module.parameters():
        torch.nn.init.normal_(parameter, std=0.2)
    return module.eval()

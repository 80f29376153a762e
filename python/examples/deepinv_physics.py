"""A modulo camera as a physics of DeepInverse, whose tensors are N x C x H x W.

    pip install ./python && pip install deepinv==0.5.0 torch==2.15.0
    python python/examples/deepinv_physics.py
"""

from typing import Any

import torch
from deepinv.physics import Physics

import modulo_camera as modulo


class ModuloCamera(Physics):  # type: ignore[misc]
    """The codes of a sensor of radiance relative to full scale, and that radiance of its codes.

    The forward operator is no differentiable one: the codes are integers.

    Parameters
    ----------
    sensor : modulo.Sensor
        The sensor, without a mosaic.
    """

    def __init__(self, sensor: modulo.Sensor) -> None:
        super().__init__()
        # `sensor` is taken by DeepInverse.
        self.camera = sensor

    def A(self, x: torch.Tensor, **kwargs: Any) -> torch.Tensor:
        """Returns the codes, N x C x H x W float32, of the radiance x in [0, 1), N x C x H x W with C = 1 or 3."""
        exposure = self.camera.expose(x.detach().cpu().float().numpy(), channel_axis=1)
        return torch.from_numpy(exposure.modulo.astype("float32")).to(x.device)

    def A_dagger(self, y: torch.Tensor, x_init: torch.Tensor | None = None, **kwargs: Any) -> torch.Tensor:
        """Returns the radiance relative to full scale, N x C x H x W, of the codes y by the method `auto`; `ValueError` for what are no codes."""
        codes = y.detach().cpu().to(torch.int64)
        if not torch.equal(codes.to(y.dtype), y.detach().cpu()) or codes.min() < 0 or codes.max() > 65535:
            raise ValueError("y holds numbers that are no codes; give the whole numbers that the camera delivers")
        radiance = self.camera.unwrap(codes.numpy().astype("uint16"), channel_axis=1).radiance
        one = self.camera.parameters
        # The middle of each code.
        return torch.from_numpy((radiance + 0.5) / (one["headroom"] * one["alpha"] * 2 ** one["bits"])).to(y.device)


if __name__ == "__main__":
    frames = [next(modulo.read_source(f"scene://{name}?seed=4")).image for name in ("day", "glare", "night")]
    x = torch.stack([torch.from_numpy(frame).movedim(-1, 0) for frame in frames])
    physics = ModuloCamera(modulo.Sensor(bits=8, alpha=4, psf_sigma=1.4))
    y = physics(x)
    error = (physics.A_dagger(y) - x).abs().mean()
    print(f"codes {tuple(y.shape)} of 0 to {y.max():.0f}; mean error {error:.4f} of full scale, with the blur of the lens")

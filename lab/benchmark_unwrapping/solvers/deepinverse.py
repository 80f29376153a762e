"""DeepInverse: Itoh's fidelity for spatial unwrapping."""

import numpy as np
from benchopt import BaseSolver


class Solver(BaseSolver):
    """The closed form by cosine transforms, and total variation with `iterations` of ADMM after it."""

    name = "DeepInverse"
    requirements = ["pip::deepinv"]
    parameters = {"iterations": [0, 10]}

    def set_objective(self, codes, sensor):
        """Takes the codes, N x H x W x C, and the parameters of the sensor."""
        import torch

        self.codes, self.peak, self.span = codes, 2.0 ** sensor["bits"], int(np.ceil(sensor["alpha"]))
        self.image = torch.from_numpy(np.moveaxis(codes, -1, 1).astype(np.float32) / self.peak)

    def run(self, _):
        """Recovers all frames, up to a constant for each channel."""
        import deepinv
        import torch

        physics = deepinv.physics.SpatialUnwrapping(threshold=1.0, mode="floor")
        fidelity = deepinv.optim.ItohFidelity(threshold=1.0)
        with torch.no_grad():
            phi = fidelity.prox(None, self.image, physics)
            if self.iterations:
                prior = deepinv.optim.TVPrior(n_it_max=10)
                u, v = phi.clone(), torch.zeros_like(phi)
                for _ in range(self.iterations):
                    phi = fidelity.prox(u - v, self.image, physics, gamma=2.0)
                    u = prior.prox(phi + v, gamma=0.01)
                    v = v + phi - u
                phi = u
        self.phi = np.moveaxis(phi.numpy(), 1, -1).astype(float) * self.peak

    def get_result(self):
        """Returns the codes with the counts of phi, whose constant takes the most samples into the range of the sensor."""
        turns = (self.phi - self.codes) / self.peak
        for frame in turns:
            for channel in np.moveaxis(frame, -1, 0):
                # The part of the constant below one turn leaves the smallest residual.
                channel -= np.angle(np.mean(np.exp(2j * np.pi * channel))) / (2 * np.pi)
                counts = np.rint(channel).astype(int)
                starts = range(counts.min() - self.span + 1, counts.max() + 1)
                votes = [np.count_nonzero((counts >= start) & (counts < start + self.span)) for start in starts]
                # The highest of equal starts is the lowest radiance.
                best = max(zip(votes, starts))[1]
                channel[...] = (counts - best).clip(0, self.span - 1)
        return dict(radiance=self.codes + self.peak * turns)

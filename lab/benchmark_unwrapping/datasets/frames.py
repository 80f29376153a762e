"""Frames behind a simulated modulo sensor."""

import itertools

import numpy as np
from benchopt import BaseDataset


class Dataset(BaseDataset):
    """The first `frames` frames of a source, as the sensor sees them."""

    name = "frames"
    requirements = ["pip::modulo-camera"]
    parameters = {
        "source": ["scene://day?seed=1", "scene://tunnel?seed=2", "scene://glare?seed=3"],
        "alpha": [2.0, 4.0],
        "psf_sigma": [1.0],
        "read_noise": [0.0],
        "frames": [1],
    }
    test_parameters = {"source": ["scene://day?seed=1&width=64&height=48"], "alpha": [2.0]}

    def get_data(self):
        """Returns codes, true counts and radiance, N x H x W x C, and the parameters of the sensor."""
        import modulo_camera

        told = dict(bits=8, alpha=self.alpha, psf_sigma=self.psf_sigma, read_noise=self.read_noise)
        sensor = modulo_camera.Sensor(**told)
        read = itertools.islice(modulo_camera.read_source(self.source), self.frames)
        exposures = [sensor.expose(frame.image) for frame in read]
        codes = np.stack([one.modulo for one in exposures])
        counts = np.stack([one.counts for one in exposures]).astype(int)
        return dict(codes=codes, counts=counts, radiance=codes + 256.0 * counts, sensor=told)

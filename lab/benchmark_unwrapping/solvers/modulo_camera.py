"""The methods of this suite."""

import numpy as np
from benchopt import BaseSolver


class Solver(BaseSolver):
    """`modulo_camera.Sensor.unwrap`, on one core."""

    name = "modulo-camera"
    requirements = ["pip::modulo-camera"]
    parameters = {"method": ["auto", "lines", "spud"]}

    def set_objective(self, codes, sensor):
        """Takes the codes, N x H x W x C, and the parameters of the sensor."""
        import modulo_camera

        self.codes, self.sensor = codes, modulo_camera.Sensor(**sensor)

    def run(self, _):
        """Recovers one frame after the other."""
        self.radiance = [self.sensor.unwrap(codes, self.method).radiance for codes in self.codes]

    def get_result(self):
        """Returns the radiance in code units."""
        return dict(radiance=np.stack(self.radiance).astype(float))

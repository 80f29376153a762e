"""How much of a modulo image a solver recovers."""

import numpy as np
from benchopt import BaseObjective


class Objective(BaseObjective):
    """Samples with a wrong wrap count, and the error of the radiance."""

    name = "Unwrapping of modulo images"
    min_benchopt_version = "1.10"
    sampling_strategy = "run_once"
    requirements = ["numpy"]
    test_dataset_name = "frames"

    def set_data(self, codes, counts, radiance, sensor):
        """Takes codes and true counts, N x H x W x C, the true radiance in code units, and the parameters of the sensor."""
        self.codes, self.counts, self.radiance, self.sensor = codes, counts, radiance, sensor

    def get_objective(self):
        """Returns what a solver is told: the codes, and the parameters of the sensor."""
        return dict(codes=self.codes, sensor=self.sensor)

    def get_one_result(self):
        """Returns a result that is right."""
        return dict(radiance=self.radiance)

    def evaluate_result(self, radiance):
        """Compares the radiance of a solver, N x H x W x C in code units, with the truth."""
        peak = 2.0 ** self.sensor["bits"]
        # What a sample has too much, in whole peaks.
        wrong = np.rint((radiance - self.codes) / peak).astype(int) - self.counts
        off = np.array([[[_most_frequent(channel)] for channel in np.moveaxis(frame, -1, 0)] for frame in wrong])
        wrong_up_to_offset = wrong - np.moveaxis(off[..., None], 1, -1)
        error = np.mean(((radiance - self.radiance) / (peak * self.sensor["alpha"])) ** 2)
        return dict(
            value=100.0 * np.mean(wrong != 0),
            up_to_offset=100.0 * np.mean(wrong_up_to_offset != 0),
            # An error of a tenth of a code is the least that is told apart.
            psnr_db=-10.0 * np.log10(max(error, (0.1 / (peak * self.sensor["alpha"])) ** 2)),
        )


def _most_frequent(values):
    found, votes = np.unique(values, return_counts=True)
    return found[votes.argmax()]

"""Random numbers that depend only on seed, sensor and sample, and the noise made from them."""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.twin.sensors.specification import SensorSpecification

_NO_NUMBERS = [0, 0, 0, 0]


class SensorNoise:
    """The errors of one sensor.

    The numbers of sample k come from a counter-based generator (Philox; Salmon et al., Parallel random
    numbers: as easy as 1, 2, 3, 2011) keyed by seed and name, with k in its counter: they do not depend on
        other sensors or previous samples.

    Args:
        specification: Specification of the sensor.
        seed: Seed of the suite.
    """

    def __init__(self, specification: SensorSpecification, seed: int) -> None:
        self.specification = specification
        words = np.random.SeedSequence([seed, zlib.crc32(specification.name.encode())])
        self._key = words.generate_state(2, np.uint64).astype(np.uint64)
        self._biases: dict[tuple[int, ...], Array] = {}
        self._source = np.random.Philox(key=self._key)
        self._random = np.random.Generator(self._source)
        # The low word counts the numbers drawn; the third is the sample, the fourth distinguishes biases.
        self._counter = [0, 0, 0, 0]
        self._start: Any = {
            "bit_generator": "Philox",
            "state": {"counter": self._counter, "key": self._key.tolist()},
            "buffer": _NO_NUMBERS,
            "buffer_pos": len(_NO_NUMBERS),
            "has_uint32": 0,
            "uinteger": 0,
        }

    def generator(self, sample: int) -> np.random.Generator:
        """Return the random generator of a sample; different samples share no numbers.

        There is one generator, whose counter is set for each sample.
        """
        self._counter[2] = sample
        self._source.state = self._start
        return self._random

    def bias(self, shape: tuple[int, ...]) -> Array:
        """Return the constant errors, drawn once, in the sensor's unit."""
        if shape not in self._biases:
            random = np.random.Generator(np.random.Philox(key=self._key, counter=[0, 0, 0, 1]))
            self._biases[shape] = self.specification.bias * random.standard_normal(shape)
        return self._biases[shape]

    def disturbed(self, truth: Array, sample: int, deviation: Any = None) -> Array:
        """Return truth with bias and noise, rounded to the resolution.

        Args:
            truth: True values in the sensor's unit, shape (...); infinities stay.
            sample: Index of the sample.
            deviation: Standard deviation of the noise, one number or of the truth's shape; from the
                specification if omitted.
        """
        noise = self.specification.noise if deviation is None else deviation
        value = truth + self.bias(truth.shape) + noise * self.generator(sample).standard_normal(truth.shape)
        return rounded_to(self.specification.resolution, np.asarray(value))


def rounded_to(step: float, values: Array) -> Array:
    """Return values rounded in place to the nearest multiple of a step; a step of 0 rounds nothing.

    Args:
        step: Step in the unit of the values.
        values: The values, shape (...).
    """
    if step:
        values /= step
        np.rint(values, out=values)
        values *= step
    return values


def within_range(minimum: float, maximum: float, distance: Array) -> Array:
    """Return distances, with -inf below the minimum and inf above the maximum (ROS's REP 117).

    Args:
        minimum: Minimum distance that a sensor measures [m].
        maximum: Maximum distance that a sensor measures [m].
        distance: Distances [m], shape (...).
    """
    near = np.where(distance < minimum, -np.inf, distance)
    return np.where(distance > maximum, np.inf, near)

"""Sensors of one rate, read together: their truths and readings stand side by side in one row."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.twin.sensors.noise import rounded_to
from pepper_kin.twin.sensors.reading import Reading, SensedState
from pepper_kin.twin.sensors.recording import ReadingSeries
from pepper_kin.twin.sensors.sensor import ErringSensor, LinearSensor, Sensor

_EARLY = 1e-6  # of a period: a clock that counts steps may be late by rounding
_LONGEST = 1000  # numbers of a reading that stand in the row; pictures are kept by themselves


class Sample(NamedTuple):
    """Readings of one time.

    Attributes:
        time: [s].
        truth: Of all sensors in the row.
        value: What they say.
        pictures: Truth and value of those that are kept by themselves.
    """

    time: float
    truth: Array
    value: Array
    pictures: tuple[tuple[NDArray[Any], NDArray[Any]], ...]


class SampledTogether:
    """Sensors of one rate.

    Args:
        rate: Samples per second [Hz].
        sensors: Name -> sensor, one or more.
        noise: Whether readings are disturbed.

    Attributes:
        frames: Frames whose poses the sensors use.
        uses_scene: Whether any of them measures the surroundings of the robot.
    """

    def __init__(self, rate: float, sensors: Mapping[str, Sensor], *, noise: bool) -> None:
        self._rate, self._noise, self._sensors = rate, noise, sensors
        self._parts: dict[str, slice] = {}
        linear = {name: s for name, s in sensors.items() if isinstance(s, LinearSensor)}
        erring = {name: s for name, s in sensors.items() if isinstance(s, ErringSensor)}
        self._linear = _Errors(linear.values())
        rows: list[tuple[Sensor, slice]] = []
        self._erring: list[tuple[ErringSensor, slice]] = []
        self._apart: dict[str, ErringSensor] = {}
        self._width = 0
        for name, sensor in (*linear.items(), *erring.items()):
            size = math.prod(sensor.shape)
            if isinstance(sensor, ErringSensor) and size > _LONGEST:
                self._apart[name] = sensor
                continue
            part = slice(self._width, self._width + size)
            self._parts[name], self._width = part, part.stop
            rows.append((sensor, part))
            if isinstance(sensor, ErringSensor) and not sensor.exact:
                self._erring.append((sensor, part))
        self._truths = [(sensor.truth, part) for sensor, part in rows]
        self.frames = tuple({s.specification.frame: None for s in sensors.values() if s.specification.frame})
        self.uses_scene = any(sensor.uses_scene for sensor in sensors.values())
        self.reset()

    def reset(self) -> None:
        """Start again: the next state is read, and what was recorded is forgotten."""
        self._sample = -1
        self._times: list[float] = []
        self._samples: list[Sample] = []
        for sensor in self._sensors.values():
            sensor.reset()

    @property
    def due(self) -> float:
        """Time of the next sample [s]."""
        return (self._sample + 1 - _EARLY) / self._rate

    def count_due(self, time: float) -> int:
        """Return the number of the sample that is due at a time [s] and count it as taken; -1 for none."""
        sample = math.floor(time * self._rate + _EARLY)
        if sample <= self._sample:
            return -1
        self._sample = sample
        return sample

    def take(self, state: SensedState, sample: int) -> Sample:
        """Return the readings of a state, as the sample of a number."""
        truth = np.empty(self._width)
        for find, part in self._truths:
            truth[part] = find(state)
        value = truth.copy()
        self._linear.add_to(value, sample if self._noise else None)
        for sensor, part in self._erring:
            value[part] = self._said(sensor, truth[part].reshape(sensor.shape), sample)
        pictures = []
        for sensor in self._apart.values():
            picture = sensor.truth(state)
            pictures.append((picture, self._said(sensor, picture, sample)))
        return Sample(state.time, truth, value, tuple(pictures))

    def record(self, sample: Sample) -> None:
        """Keep a sample."""
        self._times.append(sample.time)
        self._samples.append(sample)

    def readings(self, sample: Sample) -> Iterator[tuple[str, Reading]]:
        """Return names and readings of a sample."""
        for name, rows in self._by_name([sample]):
            about = self._sensors[name].specification
            truth, value = (row[0] for row in rows)
            yield name, Reading(sample.time, value, truth, about.unit, about.frame)

    def series(self, start: float) -> Iterator[tuple[str, ReadingSeries]]:
        """Return names and what was recorded since a time [s], from which times are counted."""
        first = bisect_left(self._times, start - 1e-9)
        times = np.array(self._times[first:]) - start
        if not len(times):
            return
        for name, (truth, value) in self._by_name(self._samples[first:]):
            about = self._sensors[name].specification
            yield name, ReadingSeries(times, value, truth, about.unit, about.frame)

    def _by_name(self, samples: list[Sample]) -> Iterator[tuple[str, list[NDArray[Any]]]]:
        """Return names and truths and values of samples, shape (k, ...) each."""
        truth, value = (np.array([sample[i] for sample in samples]) for i in (1, 2))
        for name, part in self._parts.items():
            sensor, shape = self._sensors[name], (len(samples), *self._sensors[name].shape)
            rows = (array[:, part].reshape(shape) for array in (truth, value))
            yield name, [array.astype(sensor.dtype, copy=False) for array in rows]
        for k, name in enumerate(self._apart):
            yield name, [np.stack([sample.pictures[k][i] for sample in samples]) for i in (0, 1)]

    def _said(self, sensor: ErringSensor, truth: NDArray[Any], sample: int) -> NDArray[Any]:
        """Return a sensor's reading of a truth, both of the sensor's shape and in its unit."""
        if not self._noise:
            return sensor.limited(truth)
        return sensor.limited(sensor.measured(truth.astype(sensor.dtype, copy=False), sample))


class _Errors:
    """Bias, noise, resolution and range of linear sensors side by side."""

    def __init__(self, sensors: Iterable[LinearSensor]) -> None:
        biases, columns = [np.empty(0)], [np.empty((5, 0))]
        self._random, self._rounded, size = [], [], 0
        for sensor in sensors:
            about, bias = sensor.specification, sensor.noise.bias(sensor.shape).ravel()
            numbers = (about.noise, *sensor.clipped, *sensor.in_range)
            biases.append(bias)
            columns.append(np.repeat(np.array(numbers)[:, np.newaxis], bias.size, axis=1))
            part = slice(size, size + bias.size)
            size = part.stop
            self._random.append((sensor.noise, part))
            if about.resolution:
                self._rounded.append((part, about.resolution))
        self._bias, self._noise = np.concatenate(biases), np.empty(size)
        rows = np.concatenate(columns, axis=1)
        self._deviation, self._lowest, self._highest, self._least, self._most = rows

    def add_to(self, row: Array, sample: int | None) -> None:
        """Turn truths into readings.

        Args:
            row: Begins with the truths of the linear sensors, each in its unit, shape (k,).
            sample: Number of the sample; None for no errors, but the range.
        """
        value, noise = row[: len(self._bias)], self._noise
        if sample is not None:
            for source, part in self._random:
                source.generator(sample).standard_normal(out=noise[part])
            value += self._bias
            np.multiply(noise, self._deviation, out=noise)
            value += noise
            for part, step in self._rounded:
                rounded_to(step, value[part])
        np.maximum(value, self._lowest, out=value)
        np.minimum(value, self._highest, out=value)
        near, far = value < self._least, value > self._most
        value[near], value[far] = -np.inf, np.inf

"""When the arm is where: smooth motion through waypoints within joint limits."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from tablesetting.irl.arrays import Array
from tablesetting.planner.load import Load

CONTROL_PERIOD: Final = 0.008
"""Time between two commands to the servos, in [s]."""

_SPEED_SHARE: Final = 0.9  # Of the limit; the servos need the rest to make up for lags.
_BRAKE_SHARE: Final = 0.5  # Of the acceleration; the path may bend as well.
_SAMPLES_PER_WAYPOINT: Final = 32  # To find the extremes of a path.


@dataclass(frozen=True)
class Step:
    """One phase of a motion, as commands at the control rate.

    Attributes:
        phase: What the arm does, such as "lift".
        positions: Arm joints, shape (T, 6), in [rad].
        velocities: Their rates, shape (T, 6), in [rad/s].
        torques: What the motion takes, shape (T, 6), in [Nm].
        opening: Commanded travel of each finger, in [m].
    """

    phase: str
    positions: Array
    velocities: Array
    torques: Array
    opening: float


def move_through(
    phase: str, waypoints: Array, opening: float, load: Load, slowdown: float = 1.0
) -> Step:
    """Move from rest to rest through waypoints, as fast as the limits allow.

    The path is a cubic Hermite spline over the chord length; the speed along it
    follows a minimum-jerk profile (Flash and Hogan, 1985).

    Args:
        phase: Name of the step.
        waypoints: Arm configurations, shape (N, 6) with N > 1, in [rad].
        opening: Travel of each finger meanwhile, in [m].
        load: What the servos can do, and what they carry.
        slowdown: How much longer than it must the motion may take, at least 1.

    Returns:
        The commands after the first waypoint up to the last.

    Raises:
        Overload: If the torques do not suffice, however slow the motion.
    """
    duration = slowdown * _shortest_duration(waypoints, load)
    num_ticks = max(1, int(np.ceil(duration / CONTROL_PERIOD)))
    fractions = np.arange(1, num_ticks + 1) / num_ticks
    positions, slopes = _follow(waypoints, fractions)
    velocities = slopes / (num_ticks * CONTROL_PERIOD)
    torques = load.torques(positions, velocities, CONTROL_PERIOD)
    if load.excess(torques) > 1.0:
        slower = slowdown * load.slowdown(positions, torques)
        return move_through(phase, waypoints, opening, load, slower)
    return Step(phase, positions, velocities, torques, opening)


def wait(
    phase: str, configuration: Array, opening: float, duration: float, load: Load
) -> Step:
    """Stand still for a while, in [s], as when the fingers close."""
    num_ticks = round(duration / CONTROL_PERIOD)
    positions = np.tile(configuration, (num_ticks, 1))
    torques = np.tile(load.weight(configuration), (num_ticks, 1))
    return Step(phase, positions, np.zeros_like(positions), torques, opening)


def brake(step: Step, tick: int, load: Load) -> Step:
    """Come to rest along a step that is broken off.

    Args:
        step: The step.
        tick: The last of its commands that was carried out.
        load: What the servos can do, and what they carry.

    Returns:
        The commands after that, further along the path, slower and slower.
    """
    speeds = np.abs(step.velocities[tick]) / load.servos.acceleration_limits
    duration = speeds.max() / _BRAKE_SHARE
    num_ticks = max(1, int(np.ceil(duration / CONTROL_PERIOD)))
    rates = 1.0 - np.arange(num_ticks + 1) / num_ticks
    ahead = tick + np.cumsum(0.5 * (rates[1:] + rates[:-1]))
    every = np.arange(len(step.positions))
    positions, velocities = (
        np.stack([np.interp(ahead, every, column) for column in commands.T], axis=1)
        for commands in (step.positions, step.velocities)
    )
    velocities *= rates[1:, None]
    torques = load.torques(positions, velocities, CONTROL_PERIOD, step.velocities[tick])
    return Step("brake", positions, velocities, torques, step.opening)


def reverse(step: Step, phase: str, load: Load) -> Step:
    """Go a step back, as fast as it was gone forth.

    Args:
        step: Ends at rest, or is followed by what begins with its last velocity.
        phase: Name of the new step.
        load: What the servos can do, and what they carry.
    """
    positions, velocities = step.positions[::-1], -step.velocities[::-1]
    torques = load.torques(positions, velocities, CONTROL_PERIOD, velocities[0])
    return Step(phase, positions, velocities, torques, step.opening)


def _shortest_duration(waypoints: Array, load: Load) -> float:
    """Time in which no joint exceeds its speed or acceleration, in [s]."""
    servos = load.servos
    num_samples = _SAMPLES_PER_WAYPOINT * len(waypoints)
    _, rates = _follow(waypoints, np.linspace(0.0, 1.0, num_samples + 1))
    rate_changes = np.diff(rates, axis=0) * num_samples
    by_speed = np.max(np.abs(rates) / (_SPEED_SHARE * servos.speed_limits))
    by_acceleration = np.max(np.abs(rate_changes) / servos.acceleration_limits)
    return float(max(by_speed, np.sqrt(by_acceleration)))


def _follow(waypoints: Array, fractions: Array) -> tuple[Array, Array]:
    """Positions at fractions of the duration, and their rates per duration."""
    progress = fractions**3 * (10.0 + fractions * (-15.0 + 6.0 * fractions))
    progress_rate = 30.0 * (fractions * (1.0 - fractions)) ** 2
    positions, tangents = _spline(waypoints, progress)
    return positions, tangents * progress_rate[:, None]


def _spline(waypoints: Array, progress: Array) -> tuple[Array, Array]:
    """Evaluate the Hermite spline and its derivative at `progress` in [0, 1]."""
    chords = np.linalg.norm(np.diff(waypoints, axis=0), axis=1)
    knots = np.concatenate([[0.0], np.cumsum(np.maximum(chords, 1e-9))])
    knots /= knots[-1]
    slopes = np.gradient(waypoints, knots, axis=0)
    left = np.clip(np.searchsorted(knots, progress, "right") - 1, 0, len(chords) - 1)
    width = (knots[left + 1] - knots[left])[:, None]
    u = (progress - knots[left])[:, None] / width
    start, end = waypoints[left], waypoints[left + 1]
    start_slope, end_slope = width * slopes[left], width * slopes[left + 1]
    bend = 2.0 * (start - end) + start_slope + end_slope
    rise = 3.0 * (end - start) - 2.0 * start_slope - end_slope
    positions = start + u * (start_slope + u * (rise + u * bend))
    tangents = (start_slope + u * (2.0 * rise + 3.0 * u * bend)) / width
    return positions, tangents

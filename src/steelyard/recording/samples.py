"""Samples: joint motion and torque, row by row, ready for a regression."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.display import html_table, joint_label
from steelyard.errors import InputError
from steelyard.files.arguments import real_array

from .cutoff.evidence import CutoffChoice

if TYPE_CHECKING:
    from steelyard.dynamics import Model
    from steelyard.dynamics.bristles import Bristles

__all__ = ["Samples", "masking_remarks", "regrouped"]

T = TypeVar("T", bound=np.generic)

FORGOTTEN = 0.01
"""Weight of the unknown state at its beginning below which a row tells of presliding: of 1 % of Coulomb friction at
most. A joint has then slid by 4.6 of its presliding displacements."""
FEW_VALUES = 1000
"""Values up to which `is_finite` asks each, in 1 µs: a control loop asks of a few a thousand times a second."""
GAP = 1.5
"""Sample times from one row to the next from which on the motion between them is not known."""
TOO_EARLY = "at a beginning, before presliding friction is known"


@dataclass(frozen=True, eq=False, repr=False)
class Samples:
    """Joint motion and torque at S instants of N joints, the input of a regression.

    The arrays are kept as read-only float64 in C order; an array that is so already is not copied.

    Parameters
    ----------
    q, dq, ddq
        (S, N) joint positions (rad or m), velocities and accelerations (per s and per s²).
    torque
        (S, N) joint torques (N·m, or N for prismatic joints).
    mask
        (S, N) booleans, true where the row of that joint is to be used; None uses all of them.
    t
        (S,) times in s, for plots; None where unknown.
    remarks
        What was found or chosen on the way to these samples, one sentence each.
    cutoff_choice
        The evidence, where the cutoff of the position filter was chosen from the data.
    cutoff
        Hz, of the position filter; None where there was none or it is unknown.
    filtered_torque
        Whether the torques went through a filter, or an anti-alias filter. Unless the regressor did so, too, estimates
        are biased by more than their intervals: a filter rounds the jumps of friction.
    regressor, regressor_model
        (S, C) the entries of the base regressor of this model, as its `base_columns` order them, which went through the
        same filters at the rate of the log; None where they did not.
    channels
        What was logged beside the motion and is needed by terms of the model, such as a temperature: (S,) or (S, N) by
        name; None where there is nothing.
    bristles
        Whose state of presliding friction the channels hold; None where it was logged, or there is none.

    Raises
    ------
    InputError
        Where a shape does not fit the others or a value is not finite.

    Examples
    --------
    >>> import numpy as np
    >>> Samples(q=np.zeros((3, 2)), dq=np.ones((3, 2)), ddq=np.zeros((3, 2)), torque=np.ones((3, 2)))
    Samples(3 rows x 2 joints, all rows used)
    """

    q: NDArray[np.float64]
    dq: NDArray[np.float64]
    ddq: NDArray[np.float64]
    torque: NDArray[np.float64]
    mask: NDArray[np.bool_] | None = None
    t: NDArray[np.float64] | None = None
    remarks: tuple[str, ...] = ()
    cutoff_choice: CutoffChoice | None = None
    cutoff: float | None = None
    filtered_torque: bool = False
    regressor: NDArray[np.float64] | None = None
    regressor_model: Model | None = None
    channels: Mapping[str, NDArray[np.float64]] | None = None
    bristles: Bristles | None = None

    def __post_init__(self) -> None:
        shape: tuple[int, ...] | None = None
        for name in ("q", "dq", "ddq", "torque"):
            array = read_only_matrix(getattr(self, name), f"`{name}` of Samples")
            shape = array.shape if shape is None else shape
            if array.shape != shape:
                raise InputError(
                    f"`{name}` of Samples has shape {array.shape} where q has {shape}; "
                    "all four need one row per sample and one column per joint."
                )
            require_finite(array, f"`{name}` of Samples")
            object.__setattr__(self, name, array)
        assert shape is not None
        if self.mask is not None:
            mask = np.ascontiguousarray(self.mask)
            if mask.dtype != np.bool_ or mask.shape != shape:
                raise InputError(
                    f"`mask` of Samples has shape {mask.shape} and type {mask.dtype}; "
                    f"it must be boolean of shape {shape}."
                )
            object.__setattr__(self, "mask", _read_only(mask))
        if self.t is not None:
            t = np.ascontiguousarray(self.t, dtype=np.float64)
            if t.shape != shape[:1]:
                raise InputError(f"`t` of Samples has shape {t.shape}; it must have one time per row, {shape[:1]}.")
            require_finite(t, "`t` of Samples")
            object.__setattr__(self, "t", _read_only(t))
        if self.regressor is not None:
            regressor = read_only_matrix(self.regressor, "`regressor` of Samples")
            if len(regressor) != shape[0]:
                raise InputError(f"`regressor` of Samples has {len(regressor)} rows where q has {shape[0]}.")
            object.__setattr__(self, "regressor", regressor)
        if self.channels is not None:
            object.__setattr__(self, "channels", checked_channels(self.channels, shape, "Samples"))
        object.__setattr__(self, "remarks", tuple(self.remarks))

    def is_biased_for(self, model: Model) -> bool:
        """Return whether torques went through a filter that the regressor of a model did not."""
        return self.filtered_torque and self.regressor_model is not model

    def channels_for(self, model: Model, part: slice | NDArray[np.intp] = slice(None)) -> NDArray[np.float64] | None:
        """Return what the terms of a model need of the channels, (S, K N); None where they need nothing.

        Raises
        ------
        InputError
            Where these samples do not have it; see `Model.channel_values`.
        """
        if not model.robot.channels:
            return None
        given = {name: values[part] for name, values in (self.channels or {}).items()}
        return model.channel_values(given, self.q[part].shape)

    def entries_for(self, model: Model, part: slice | NDArray[np.intp] = slice(None)) -> NDArray[np.float64]:
        """Return the entries of the base regressor of a model, (S, C): what is held of them, or else computed."""
        if self.regressor is not None and self.regressor_model is model:
            return self.regressor[part]
        logged = self.channels_for(model, part)
        return model.base_columns.entries(self.q[part], self.dq[part], self.ddq[part], logged)

    def with_presliding(self, model: Model) -> Samples:
        """Return the samples with the state of friction that remembers the motion, which terms of a model need.

        The rows are taken in their order, from one gap of the times to the next. What happened before the first of them
        is not known, so that rows of a joint at which it still counts for more than 1 % are masked. Samples that have
        the state already, as those of logs that were processed with the model, and any where no term needs it are
        returned as they are; the state of other bristles is computed anew.

        Raises
        ------
        InputError
            Where torques were filtered: the columns of the friction must go through the same filter.
        """
        if not model.remembers:
            return self
        foreign = self.bristles is not None and not self.bristles.are(model.bristles)
        if model.bristles.channel in (self.channels or {}) and not foreign:
            return self
        if self.filtered_torque:
            raise InputError(
                "The torques of these samples were filtered, and what terms need of the motion before was not; give "
                "the model to Recording.process, which filters both."
            )
        starts = [0]
        if self.t is not None and self.count > 2:
            steps = np.diff(self.t)
            typical = float(np.median(steps))
            starts += (np.flatnonzero((steps > GAP * typical) | (steps <= 0.0)) + 1).tolist()
        states, weights = model.bristles.along(self.q, self.dq, starts)
        mask = self.used_rows & (weights <= FORGOTTEN)
        lost = self.used - np.count_nonzero(mask, axis=0)
        return replace(
            self,
            mask=None if mask.all() else mask,
            channels={**(self.channels or {}), model.bristles.channel: states},
            bristles=model.bristles,
            remarks=(*self.remarks, *masking_remarks({TOO_EARLY: lost}, model.robot.joint_names)),
        )

    def with_states(self, model: Model) -> Samples:
        """Return the samples as `with_presliding` does, whatever was done to the torques, for choices by a model.

        Without the states, all that friction remembers looks like a delay, a bad filter, or less friction near rest.
        """
        return replace(self, filtered_torque=False).with_presliding(model) if model.remembers else self

    @property
    def count(self) -> int:
        """Number of rows, S."""
        return int(self.q.shape[0])

    @property
    def joint_count(self) -> int:
        """Number of joints, N."""
        return int(self.q.shape[1])

    @property
    def used_rows(self) -> NDArray[np.bool_]:
        """(S, N) which rows of each joint are used: those of the mask, or all."""
        return np.ones(self.q.shape, dtype=bool) if self.mask is None else self.mask

    @property
    def used(self) -> NDArray[np.int64]:
        """(N,) how many rows of each joint are used."""
        used: NDArray[np.int64] = np.sum(self.used_rows, axis=0, dtype=np.int64)
        return used

    @classmethod
    def joined(cls, parts: Sequence[Samples]) -> Self:
        """Put samples one after the other (recordings of the same robot).

        Raises
        ------
        InputError
            Where there is nothing to join or the joint counts differ.
        """
        if not parts:
            raise InputError("there are no samples to join; give at least one Samples.")
        counts = sorted({part.joint_count for part in parts})
        if len(counts) > 1:
            raise InputError(
                f"samples of {' and '.join(map(str, counts))} joints cannot be joined; use one robot's logs."
            )
        mask = None
        if any(part.mask is not None for part in parts):
            mask = np.vstack([part.used_rows for part in parts])
        times = [part.t for part in parts if part.t is not None]
        model, regressor = parts[0].regressor_model, None
        if model is not None and all(part.regressor_model is model for part in parts):
            regressor = np.vstack([part.regressor for part in parts if part.regressor is not None])
        channels, bristles = joined_channels([part.channels for part in parts]), parts[0].bristles
        if any(not _are(part.bristles, bristles) for part in parts):  # their states are computed anew where needed
            states = {part.bristles.channel for part in parts if part.bristles is not None}
            channels = {name: values for name, values in (channels or {}).items() if name not in states} or None
            bristles = None
        return cls(
            q=np.vstack([part.q for part in parts]),
            dq=np.vstack([part.dq for part in parts]),
            ddq=np.vstack([part.ddq for part in parts]),
            torque=np.vstack([part.torque for part in parts]),
            mask=mask,
            t=np.concatenate(times) if len(times) == len(parts) else None,
            remarks=tuple(dict.fromkeys(remark for part in parts for remark in part.remarks)),
            cutoff_choice=next((part.cutoff_choice for part in parts if part.cutoff_choice is not None), None),
            filtered_torque=any(part.filtered_torque for part in parts),
            cutoff=parts[0].cutoff if len({part.cutoff for part in parts}) == 1 else None,
            regressor=regressor,
            regressor_model=None if regressor is None else model,
            channels=channels,
            bristles=bristles,
        )

    def rows(self, start: int, stop: int, with_remarks: bool = True) -> Samples:
        """Return rows start:stop, with the remarks and what was chosen, or without."""
        rows = slice(start, stop)
        if not len(range(self.count)[rows]):
            raise InputError(f"rows {start} to {stop} hold no sample; the samples have rows 0 to {self.count}.")
        cut = copy(self)  # whose rows were checked already
        for name in ("q", "dq", "ddq", "torque", "mask", "t", "regressor"):
            values = getattr(self, name)
            object.__setattr__(cut, name, None if values is None else values[rows])
        object.__setattr__(cut, "channels", cut_channels(self.channels, rows))
        if not with_remarks:
            object.__setattr__(cut, "remarks", ())
            object.__setattr__(cut, "cutoff_choice", None)
        return cut

    def __repr__(self) -> str:
        total = self.count * self.joint_count
        used = int(self.used.sum())
        rows = "all rows used" if used == total else f"{used} of {total} joint rows used"
        return f"Samples({self.count} rows x {self.joint_count} joints, {rows})"

    def _repr_html_(self) -> str:
        heads = ("joint", "rows used", "q", "max |dq|", "max |ddq|", "max |torque|")
        rows = []
        for j, used in enumerate(self.used):
            q, dq, ddq, torque = (array[:, j] for array in (self.q, self.dq, self.ddq, self.torque))
            greatest = (f"{np.abs(array).max():.4g}" for array in (dq, ddq, torque))
            rows.append((j + 1, used, f"{q.min():.4g} … {q.max():.4g}", *greatest))
        return html_table(repr(self), heads, rows, self.remarks)


def masking_remarks(
    counts: dict[str, NDArray[np.intp]], joint_names: Sequence[str] | None, when: str = ""
) -> tuple[str, ...]:
    """Return one sentence for each reason why rows were masked."""
    sentences = []
    for name, of_joints in counts.items():
        if of_joints.any():
            shares = ", ".join(
                f"{count} of {joint_label(j, joint_names)}" for j, count in enumerate(of_joints) if count
            )
            if len(of_joints) > 1 and np.all(of_joints == of_joints[0]):
                shares = f"{of_joints[0]} of each joint"
            sentences.append(f"Rows left out{' ' * bool(when)}{when} because they are {name}: {shares}.")
    return tuple(sentences)


def nothing_left(
    source: str, rows: int, duration: float, counts: dict[str, NDArray[np.intp]], joint_names: Sequence[str] | None
) -> InputError:
    """Return what is said of a log of which no row is left for any joint."""
    said = (
        f"{source} has {rows} rows in {duration:.6g} s, of which [processing] leaves none to use; check delay, "
        "velocity_threshold, exclude_joints and the other options that leave rows out."
    )
    return InputError(" ".join((said, *masking_remarks(counts, joint_names))))


def regrouped(parts: Iterable[Samples], count: int) -> Iterator[Samples]:
    """Cut and join a stream of samples so that each holds `count` rows, and the last one the rest.

    Rows are neither changed nor moved; remarks go with the first row of the part that had them.
    """
    held: list[Samples] = []
    size = 0
    for part in parts:
        start = 0
        while start < part.count:
            stop = min(part.count, start + count - size)
            held.append(part if stop - start == part.count else part.rows(start, stop, start == 0))
            size, start = size + stop - start, stop
            if size == count:
                yield held[0] if len(held) == 1 else Samples.joined(held)
                held, size = [], 0
    if held:
        yield held[0] if len(held) == 1 else Samples.joined(held)


def _read_only(array: NDArray[T]) -> NDArray[T]:
    """Return a read-only view; the array of the caller stays writable."""
    view = array.view()
    view.flags.writeable = False
    return view


def checked_channels(
    channels: Mapping[str, ArrayLike], shape: tuple[int, ...], owner: str
) -> dict[str, NDArray[np.float64]]:
    """Return channels as read-only (S, N) arrays, of which those (S,) hold for every joint."""
    found = {}
    for name, given in channels.items():
        values = np.asarray(given, dtype=np.float64)
        values = values[:, None] if values.ndim == 1 else values
        if values.ndim != 2 or len(values) != shape[0] or values.shape[1] not in (1, shape[1]):
            raise InputError(
                f"The channel {name!r} of {owner} has shape {np.shape(given)}; expected one value per row, "
                f"{shape[:1]}, or one for each joint, {shape}."
            )
        require_finite(values, f"the channel {name!r} of {owner}")
        found[name] = read_only_matrix(np.broadcast_to(values, shape), f"the channel {name!r} of {owner}")
    return found


def _are(some: Bristles | None, others: Bristles | None) -> bool:
    """Tell whether the states of some bristles, or logged ones, are those of others."""
    return some is others if some is None or others is None else some.are(others)


def cut_channels(
    channels: Mapping[str, NDArray[np.float64]] | None, rows: slice | NDArray[Any]
) -> dict[str, NDArray[np.float64]] | None:
    """Return some of the rows of channels."""
    return None if channels is None else {name: values[rows] for name, values in channels.items()}


def joined_channels(parts: Sequence[Mapping[str, NDArray[np.float64]] | None]) -> dict[str, NDArray[np.float64]] | None:
    """Put the channels of parts one after the other: those that all parts have."""
    given = [part or {} for part in parts]
    names = [name for name in given[0] if all(name in part for part in given)]
    return {name: np.concatenate([part[name] for part in given]) for name in names} or None


def read_only_matrix(values: ArrayLike, what: str) -> NDArray[np.float64]:
    """Return `values` as a read-only (S, N) float64 array in C order, S and N at least 1."""
    array = _numbers(values, what)
    if array.ndim != 2 or 0 in array.shape:
        raise InputError(f"{what} has shape {array.shape}; expected one row per sample and one column per joint.")
    return _read_only(array)


def read_only_vector(values: ArrayLike, what: str) -> NDArray[np.float64]:
    """Return `values` as a read-only (S,) float64 array."""
    array = _numbers(values, what)
    if array.ndim != 1 or array.size == 0:
        raise InputError(f"{what} has shape {array.shape}; expected one value per sample.")
    return _read_only(array)


def _numbers(values: ArrayLike, what: str) -> NDArray[np.float64]:
    return np.ascontiguousarray(real_array(values, what, "an array of real numbers, NaN where there is none"))


def is_finite(array: NDArray[np.float64]) -> bool:
    """Tell whether no value is NaN or infinite; of many values False also where some are huge, of about 1e300."""
    if array.size <= FEW_VALUES:
        return bool(np.isfinite(array).all())
    # A sum is finite only where all values are, needs no array of its own, and takes half the time of both extremes.
    with np.errstate(over="ignore", invalid="ignore"):
        return bool(np.isfinite(array.sum()))


def require_finite(array: NDArray[np.float64], what: str) -> None:
    """Raise InputError at the first value of `array` (rows first) that is NaN or infinite."""
    if is_finite(array):
        return
    good = np.isfinite(array)
    if good.all():  # and some are huge
        return
    place = np.unravel_index(int(np.argmin(good)), array.shape)
    column = f", column {place[1] + 1}" if array.ndim == 2 else ""
    raise InputError(
        f"{what} is not finite in {np.count_nonzero(~good)} places, first in row {place[0] + 1}{column}; "
        "remove those rows or fill them before use."
    )

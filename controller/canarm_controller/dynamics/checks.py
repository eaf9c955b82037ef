"""Checks that states have the right shapes and are finite. Errors name quantity, sample and joint."""

from collections.abc import Sequence
from math import isfinite

import numpy as np

from ..errors import DynamicsError
from .chain import Floats


def check_state(joint_names: Sequence[str], **quantities: object) -> None:
    """Raise `DynamicsError` unless every quantity has one finite number per joint; says which one of which joint."""
    for name, values in quantities.items():
        numbers = _as_floats(name, values)
        if numbers.shape != (len(joint_names),):
            raise DynamicsError(
                f"{name} has shape {numbers.shape}; must be ({len(joint_names)},): one number per joint"
            )
        for joint, value in zip(joint_names, numbers, strict=True):
            if not isfinite(value):
                raise DynamicsError(f"{name} of {joint} = {value}; must be finite")


def check_samples(joint_names: Sequence[str], **quantities: Floats) -> None:
    """Raise `DynamicsError` unless all arrays are (joints, samples), alike and finite; names the sample and joint."""
    samples = None
    for name, values in quantities.items():
        samples = values.shape[-1] if samples is None and values.ndim else samples
        if values.shape != (len(joint_names), samples):
            raise DynamicsError(
                f"{name}: {' x '.join(map(str, values.shape)) or 'a single number'} (joints x samples); "
                f"must be {len(joint_names)} x {samples if samples is not None else 'n'}"
            )
    for name, values in quantities.items():
        finite = np.isfinite(values)
        if not finite.all():
            sample, joint = np.argwhere(~finite.T)[0]
            raise DynamicsError(
                f"{name} of {joint_names[joint]} at sample {sample} = {values[joint, sample]}; must be finite"
            )


def _as_floats(name: str, values: object) -> Floats:
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise DynamicsError(f"{name} = {values!r}; must be one number per joint") from None

"""A study as plain values: what makes it the same study, so that its runs can be taken for done."""

from typing import Any

from ..cli import version
from ..draws import Choice
from .checking import named_files
from .journal import fingerprint
from .plan import Axis, Sample, Study


def description(study: Study) -> dict[str, Any]:
    """Settings and axes of the study, the version that runs it, and what is in the files that it names."""
    is_grid = study.sample is Sample.GRID
    sample = {} if is_grid else {"draws": study.draws, "draw_seed": study.draw_seed}
    base = {name: getattr(study.base, name) for name in study.base.__dataclass_fields__}
    return {
        "title": study.title,
        "canarm": version(),
        "sample": study.sample.value,
        **sample,
        "run": base | {"settings": dict(study.base.settings), "truth": dict(study.base.truth)},
        "vary": {axis.name: _plain(axis, steps, is_grid) for axis, steps in zip(study.axes, study.steps, strict=True)},
        "files": fingerprint(named_files(study)),
    }


def _plain(axis: Axis, steps: int, is_grid: bool) -> Any:
    if isinstance(axis, Choice):
        return list(axis.values)
    plain: dict[str, Any] = {"from": axis.low, "to": axis.high}
    if getattr(axis, "is_factor", False):
        plain["scale"] = "log"
    return plain | ({"count": steps} if is_grid else {})

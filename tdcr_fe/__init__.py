"""Tendon-driven continuum robots in Exudyn."""

from pathlib import Path as _Path

__version__ = "0.2.0.dev0"

# In a clone, `elements/` and `validation/` lie beside this folder; in an installed copy they lie inside it.
_beside = _Path(__file__).resolve().parent.parent
if not (_Path(__file__).resolve().parent / "elements").is_dir() and (_beside / "elements").is_dir():
    __path__.append(str(_beside))

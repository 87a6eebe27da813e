"""Tendon-driven continuum robots in Exudyn: the public names, each imported when it is first used.

Their modules are listed in `__init__.pyi`, once, for type checkers and for this module.
"""

import os.path as _path
from importlib import import_module as _import_module

import lazy_loader as _lazy_loader

__version__ = "0.2.0"

# In a clone, `elements/` and `validation/` lie beside this folder, where Python does not look for parts of the package;
# in an installed copy they lie inside it.
_here = _path.dirname(_path.realpath(__file__))
_clone = _path.dirname(_here)
if not _path.isdir(_path.join(_here, "elements")) and _path.isdir(_path.join(_clone, "elements")):
    __path__.append(_clone)

_attribute, __dir__, __all__ = _lazy_loader.attach_stub(__name__, __file__)
__all__ += ["__version__"]


#: Packages that are themselves the function of their name, so that their modules can be imported, too.
_CALLABLE = ("identify", "live")


def __getattr__(name: str) -> object:
    return _import_module(f"{__name__}.{name}") if name in _CALLABLE else _attribute(name)

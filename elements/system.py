"""The Exudyn system of a robot's items, without keeping it alive.

A system keeps what is stored in ``mbs.variables`` and the user functions of its items. If these kept the system in
turn, neither would ever be freed: Python does not see the references that Exudyn holds.
"""

from __future__ import annotations

import weakref

import exudyn as exu


class SystemReference:
    """A reference to a system that does not keep it alive; shared by all items of the system.

    Parameters
    ----------
    mbs
        The system.
    """

    def __init__(self, mbs: exu.MainSystem) -> None:
        self._reference = weakref.ref(mbs)

    def bind(self, mbs: exu.MainSystem) -> None:
        """Refer to the same system by another Python object; Exudyn makes a new one where the last was dropped."""
        self._reference = weakref.ref(mbs)

    @property
    def mbs(self) -> exu.MainSystem:
        """The system.

        Raises
        ------
        ReferenceError
            No Python object of the system is left.
        """
        mbs = self._reference()
        if mbs is None:
            raise ReferenceError(
                "the Exudyn system of this robot has been deleted; keep mbs and its SystemContainer"
            )
        return mbs

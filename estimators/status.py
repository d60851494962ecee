"""Statuses that say why an estimate is as it is, and what to do about it."""

from __future__ import annotations

import enum
from typing import Self


class ExplainedStatus(enum.IntEnum):
    """Base of statuses; a member is a code, a cause and a remedy. The greater, the worse.

    Attributes:
        cause: why the estimate is as it is.
        remedy: what to do about it.
    """

    cause: str
    remedy: str

    def __new__(cls, code: int, cause: str = "", remedy: str = "") -> Self:
        """One member; looking one up by its code takes the code alone."""
        member = int.__new__(cls, code)
        member._value_ = code
        member.cause, member.remedy = cause, remedy
        return member

    @property
    def text(self) -> str:
        """Cause and remedy in one line."""
        return f"{self.cause} {self.remedy}"

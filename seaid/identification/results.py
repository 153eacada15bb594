"""How results show themselves: each by its table of `seaid.report`."""

from __future__ import annotations

from typing import ClassVar


class Shown:
    """A result that `summary()` and `print` show by a table of `seaid.report`."""

    table_name: ClassVar[str]
    """The function of `seaid.report` that makes the table."""

    def summary(self) -> str:
        """Return the result as text that a human reads."""
        from seaid import report

        return str(getattr(report, self.table_name)(self))

    def __str__(self) -> str:
        return self.summary()

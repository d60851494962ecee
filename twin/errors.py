"""The one error that a person's wrong input raises."""

from __future__ import annotations


class InputError(ValueError):
    """Something a person wrote, or a file they gave, cannot be used.

    The command line prints it as one message and exits with code 2.

    Attributes:
        file: the file, or "" when the value did not come from a file.
        place: key, line, column or capture within the file.
        found: what is there.
        expected: what should be there.
        remedy: what to do about it, or "".
    """

    def __init__(
        self, found: str, expected: str, *, file: object = "", place: str = "", remedy: str = ""
    ) -> None:
        self.file = str(file)
        self.place = place
        self.found = found
        self.expected = expected
        self.remedy = remedy
        super().__init__(found)

    def __str__(self) -> str:
        where = ": ".join(part for part in (self.file, self.place) if part)
        text = f"found {self.found}; expected {self.expected}"
        if where:
            text = f"{where}: {text}"
        return f"{text}. {self.remedy}" if self.remedy else text

    def at(self, file: object, place: str = "") -> InputError:
        """The same error, said of a file and a place inside it."""
        inner = ".".join(part for part in (place, self.place) if part)
        return InputError(self.found, self.expected, file=file, place=inner, remedy=self.remedy)

"""The journal of a visit on disk: every shot is safe as soon as it is taken.

One folder. `visit.json` says what is measured with what; `plan.json` holds the exposures that were
found; `log.jsonl` one line for everything that happened; `shots/000012.shot` one shot each: a line
of JSON, the counts (float64, little endian), the mask (one byte a pixel), and a line with the
SHA-256 of all before it. Every file but the log is written whole or not at all.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hw_adapters.protocols import Applied, Frame
from twin.errors import InputError
from twin.files import write_atomically

FORMAT = "benchtwin journal"
VERSION = 1
_DIGEST = 64


@dataclass(frozen=True, eq=False)
class Taken:
    """A shot in the journal.

    Attributes:
        number: its number in the plan.
        frame: what was read; `time_s` since the beginning of the visit.
        end_s: time [s] since the beginning of the visit when the shot was over.
    """

    number: int
    frame: Frame
    end_s: float


class Journal:
    """What was captured so far.

    Args:
        folder: the journal's folder; made when it is missing.

    Raises:
        InputError: the folder cannot be made.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._shots = folder / "shots"
        try:
            self._shots.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(
                f"a folder that cannot be made ({error.strerror})", "a folder that can be written",
                file=folder,
            ) from error  # fmt: skip

    # The visit and its plan -----------------------------------------------------------------

    @property
    def started(self) -> bool:
        """Whether a visit was begun here."""
        return (self.folder / "visit.json").exists()

    def begin(self, visit: dict[str, Any]) -> None:
        """Write down what is measured with what."""
        head = {"format": FORMAT, "version": VERSION} | visit
        self._write_json("visit.json", head)

    def visit(self) -> dict[str, Any]:
        """What `begin` wrote.

        Raises:
            InputError: no journal, or one of another make.
        """
        head = self._read_json("visit.json")
        if head.get("format") != FORMAT or head.get("version") != VERSION:
            raise InputError(
                f"format {head.get('format')!r}, version {head.get('version')}",
                f"a {FORMAT} of version {VERSION}",
                file=self.folder / "visit.json",
            )
        return head

    def write_exposures(self, exposures: Mapping[str, Mapping[str, Applied]]) -> None:
        """Write down the exposures that the plan is made of."""
        table = {
            sample: {capture: asdict(applied) for capture, applied in own.items()}
            for sample, own in exposures.items()
        }
        # A list of pairs: the order of samples and captures is the order of the plan.
        pairs = [[sample, list(own.items())] for sample, own in table.items()]
        self._write_json("plan.json", {"exposures": pairs})

    def exposures(self) -> dict[str, dict[str, Applied]] | None:
        """What `write_exposures` wrote; None before.

        Raises:
            InputError: a damaged file.
        """
        if not (self.folder / "plan.json").exists():
            return None
        data = self._read_json("plan.json")
        try:
            return {
                sample: {capture: Applied(**fields) for capture, fields in own}
                for sample, own in data["exposures"]
            }
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(
                f"a file that cannot be used ({error})", "exposures",
                file=self.folder / "plan.json",
                remedy="Begin again in another folder, or delete this file to expose anew.",
            ) from error  # fmt: skip

    # Shots ----------------------------------------------------------------------------------

    def keep(self, taken: Taken) -> Path:
        """Write a shot; when this returns, it survives a power cut.

        Raises:
            InputError: the disk is full or the folder gone.
        """
        return write_atomically(self._path(taken.number), _encoded(taken))

    def put_aside(self, taken: Taken, why: str) -> Path:
        """Write a reading that cannot serve as its shot: it is no part of the measurement.

        Args:
            taken: the reading.
            why: one word, which becomes the end of the file's name.

        Raises:
            InputError: the disk is full or the folder gone.
        """
        path = self._path(taken.number)
        number = len(list(self._shots.glob(f"{path.stem}*.{why}")))
        name = f"{path.stem}-{number}.{why}" if number else f"{path.stem}.{why}"
        self.log("put_aside", number=taken.number, why=why, file=name)
        return write_atomically(path.with_name(name), _encoded(taken))

    def shots(self) -> dict[int, Taken]:
        """Every shot kept, by number; damaged ones are put aside and logged, to be taken again."""
        found = {}
        for path in sorted(self._shots.glob("*.shot")):
            taken = _decoded(path.read_bytes())
            if taken is None or self._path(taken.number) != path:
                os.replace(path, path.with_suffix(".damaged"))
                self.log("damaged", file=path.name)
                continue
            found[taken.number] = taken
        return found

    def _path(self, number: int) -> Path:
        return self._shots / f"{number:06d}.shot"

    # Log ------------------------------------------------------------------------------------

    def log(self, event: str, **fields: Any) -> None:
        """Append one line about something that happened."""
        line = json.dumps({"event": event} | fields, sort_keys=True, ensure_ascii=False)
        with (self.folder / "log.jsonl").open("a", encoding="utf-8") as file:
            file.write(line + "\n")
            file.flush()
            os.fsync(file.fileno())

    def events(self, event: str = "") -> Iterator[dict[str, Any]]:
        """What was logged, or only one kind of it; a line that a power cut broke is left out."""
        path = self.folder / "log.jsonl"
        if not path.exists():
            return
        for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
            try:
                entry = json.loads(line)
            except ValueError:
                continue
            if isinstance(entry, dict) and event in ("", entry.get("event")):
                yield entry

    def _write_json(self, name: str, value: dict[str, Any]) -> None:
        text = json.dumps(value, sort_keys=True, indent=1, ensure_ascii=False)
        write_atomically(self.folder / name, text.encode())

    def _read_json(self, name: str) -> dict[str, Any]:
        path = self.folder / name
        try:
            data = json.loads(path.read_text(encoding="utf-8"))
        except FileNotFoundError as error:
            raise InputError(
                "no journal of a visit", "one that was begun", file=path,
                remedy="Begin without --resume.",
            ) from error  # fmt: skip
        except (OSError, ValueError) as error:
            raise InputError(f"a damaged file ({error})", "JSON", file=path) from error
        if not isinstance(data, dict):
            raise InputError(f"a {type(data).__name__}", "an object", file=path)
        return data


def _encoded(taken: Taken) -> bytes:
    frame = taken.frame
    head = {
        "number": taken.number,
        "pixels": len(frame.counts),
        "full_scale": frame.full_scale,
        "applied": asdict(frame.applied),
        "time_s": frame.time_s,
        "end_s": taken.end_s,
        "pass_times_s": list(frame.pass_times_s),
    }
    body = json.dumps(head, sort_keys=True).encode() + b"\n"
    body += frame.counts.astype("<f8").tobytes() + frame.saturated.astype(np.uint8).tobytes()
    return body + b"\n" + hashlib.sha256(body).hexdigest().encode()


def _decoded(data: bytes) -> Taken | None:
    """A shot, or None where a byte is wrong."""
    body, digest = data[: -_DIGEST - 1], data[-_DIGEST:]
    if hashlib.sha256(body).hexdigest().encode() != digest:
        return None
    line, _, rest = body.partition(b"\n")
    head = json.loads(line)
    pixels = head["pixels"]
    frame = Frame(
        np.frombuffer(rest[: 8 * pixels], dtype="<f8"),
        head["full_scale"],
        np.frombuffer(rest[8 * pixels :], dtype=np.uint8) != 0,
        Applied(**head["applied"]),
        head["time_s"],
        tuple(head["pass_times_s"]),
    )
    return Taken(head["number"], frame, head["end_s"])

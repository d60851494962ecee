"""Writing files whole or not at all, and sealing netCDF files with a checksum."""

from __future__ import annotations

import contextlib
import hashlib
import io
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from twin.errors import InputError

if TYPE_CHECKING:
    from xarray import DataTree

Made = TypeVar("Made")

HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_SEAL = b"\nbenchtwin-sha256:"
_SEAL_LENGTH = len(_SEAL) + 64 + 1


def replace_file(path: Path, fill: Callable[[Path], None]) -> Path:
    """Let `fill` write a temporary file in the same folder, which then takes the file's place.

    Raises:
        InputError: the folder does not exist or cannot be written.
    """
    temporary = ""
    try:
        handle, temporary = tempfile.mkstemp(
            prefix=f".{path.name}.", suffix=".tmp", dir=path.parent
        )
        os.close(handle)
        fill(Path(temporary))
        with open(temporary, "rb") as written:
            os.fsync(written.fileno())
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(temporary, 0o666 & ~mask)
        os.replace(temporary, path)
    except OSError as error:
        raise InputError(
            f"a place that cannot be written ({error.strerror or error})",
            "a folder that exists and is writable, with space left",
            file=path,
        ) from error
    finally:
        if temporary:
            with contextlib.suppress(FileNotFoundError):
                os.unlink(temporary)
    return path


def write_atomically(path: Path, data: bytes) -> Path:
    """Write a whole file or nothing.

    Raises:
        InputError: the folder does not exist or cannot be written.
    """

    def fill(temporary: Path) -> None:
        temporary.write_bytes(data)

    return replace_file(path, fill)


def write_sealed_tree(tree: DataTree, path: Path) -> Path:
    """Write a DataTree as netCDF-4, followed by the SHA-256 of its bytes; same tree, same bytes.

    Readers of netCDF-4 stop before the seal.

    Raises:
        InputError: the folder does not exist or cannot be written.
    """

    def fill(temporary: Path) -> None:
        tree.to_netcdf(temporary, engine="h5netcdf", format="NETCDF4")
        with open(temporary, "r+b") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
            file.seek(0, os.SEEK_END)
            file.write(_SEAL + digest.encode() + b"\n")

    return replace_file(path, fill)


def read_sealed(path: Path, kind: str) -> bytes:
    """The netCDF-4 bytes of a sealed file, once their checksum is right.

    The checksum is read before the HDF5 library sees a byte: a damaged file can hang it.

    Raises:
        InputError: no such file, or one that is foreign, truncated or damaged.
    """
    try:
        raw = path.read_bytes()
    except FileNotFoundError as error:
        raise InputError("no such file", kind, file=path) from error
    except OSError as error:
        raise InputError(
            f"a file that cannot be read ({error.strerror})", kind, file=path
        ) from error
    if not raw.startswith(HDF5_SIGNATURE):
        start = raw[:8].hex(" ") if raw else "nothing"
        raise InputError(
            f"a file that is not netCDF-4 (it begins with {start})",
            f"{kind} written by benchtwin, or a folder",
            file=path,
        )
    body, seal = raw[:-_SEAL_LENGTH], raw[-_SEAL_LENGTH:]
    if not (seal.startswith(_SEAL) and seal.endswith(b"\n")):
        raise InputError(
            "no checksum at the end",
            f"{kind} written by benchtwin",
            file=path,
            remedy="The file is truncated, or another program wrote it.",
        )
    digest = hashlib.sha256(body).hexdigest()
    if seal[len(_SEAL) : -1] != digest.encode():
        raise InputError(
            f"a damaged file (its bytes have the checksum {digest[:12]}...)",
            f"the checksum {seal[len(_SEAL) : -1].decode('ascii', 'replace')[:12]}...",
            file=path,
            remedy="Take it from a copy.",
        )
    return body


def read_sealed_tree(
    path: Path, kind: str, expected: str, make: Callable[[DataTree], Made]
) -> Made:
    """What `make` finds in a sealed file's DataTree, which is closed afterwards.

    Args:
        path: of the file.
        kind: what a file of this make is called, with its article.
        expected: format and version, for the message about a file that `make` cannot use.
        make: raises KeyError, ValueError, TypeError or AttributeError where the tree is another.

    Raises:
        InputError: no such file, or one that is foreign, truncated or damaged.
    """
    body = read_sealed(path, kind)
    import xarray

    try:
        with xarray.open_datatree(
            io.BytesIO(body), engine="h5netcdf", decode_times=False, mask_and_scale=False
        ) as tree:
            return make(tree)
    except InputError as error:
        if error.file:
            raise
        raise error.at(path) from error
    except (KeyError, ValueError, TypeError, AttributeError, OSError, RuntimeError) as error:
        raise InputError(
            f"a netCDF-4 file of another make ({type(error).__name__}: {error})",
            expected,
            file=path,
        ) from error


def has_title(path: Path, title: str) -> bool:
    """Whether a path is a whole, sealed file whose tree has this title."""
    try:
        found: bool = read_sealed_tree(
            path, title, title, lambda tree: bool(tree.attrs.get("title") == title)
        )
    except InputError:
        return False
    return found

"""A look at the arrays of a model file."""

import json
import os
from pathlib import Path
from typing import Any, Dict, Iterator, Mapping, Tuple, Union

import numpy as np

_TYPES = {"U8": "u1", "U16": "<u2", "U32": "<u4", "U64": "<u8", "F32": "<f4", "F64": "<f8"}


class Model(Mapping[str, "np.ndarray"]):
    """The arrays of a model by name, read where the file is mapped, when they are looked at.

    What each of them is, stands at the head of ``model/src/file.rs``; the manifest, in RON, says the rest. Whether the contents
    are whole is not checked here: ``kinds inspect`` does.
    """

    def __init__(self, manifest: str, arrays: Dict[str, "np.ndarray"]) -> None:
        self.manifest = manifest
        self._arrays = arrays

    @property
    def id(self) -> str:
        """Identity of the model, in hexadecimal digits, as reports have it."""
        return self["digest"][:16].tobytes().hex()

    def __getitem__(self, name: str) -> "np.ndarray":
        return self._arrays[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._arrays)

    def __len__(self) -> int:
        return len(self._arrays)

    def __repr__(self) -> str:
        arrays = ", ".join(f"{name} {array.dtype} {array.shape}" for name, array in self.items())
        return f"<Model {self.id}: {arrays}>"


def load_model(path: "Union[str, os.PathLike[str]]") -> Model:
    """Opens a model file to look at its arrays, without reading them yet."""
    size = Path(path).stat().st_size
    with open(path, "rb") as file:
        length = int.from_bytes(file.read(8), "little")
        text = file.read(length) if 8 + length <= size else b""
    try:
        header = json.loads(text)
        manifest = header.pop("__metadata__")["manifest"]
        places = {name: _place(entry, 8 + length, size) for name, entry in header.items()}
    except (ValueError, KeyError, TypeError, AttributeError):
        raise ValueError(f"{path} is not a whole model file; copy it again or train anew") from None
    mapped = np.memmap(path, np.uint8, "r")
    arrays = {
        name: mapped[begin:end].view(dtype).reshape(shape) for name, (dtype, shape, begin, end) in places.items()
    }
    return Model(manifest, dict(sorted(arrays.items())))


def _place(entry: Dict[str, Any], base: int, size: int) -> "Tuple[np.dtype[Any], Tuple[int, ...], int, int]":
    """Type, shape and bytes of an array; an error if they do not fit each other or the file."""
    dtype, shape = np.dtype(_TYPES[entry["dtype"]]), tuple(entry["shape"])
    begin, end = (base + offset for offset in entry["data_offsets"])
    n_bytes = dtype.itemsize * int(np.prod(shape, dtype=np.int64))
    if not base <= begin <= end <= size or end - begin != n_bytes:
        raise ValueError
    return dtype, shape, begin, end

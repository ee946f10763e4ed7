"""A compiled program, as JAX writes it, without what only a compiler reads: it loads six times as fast and takes an eighth of the memory.

What XLA's CPU backend writes holds the machine code, the plan by which its functions are called, the plan of its buffers, and the whole
module that all this was made from, most of which are the bodies of fused loops. To load it XLA builds them all again, as objects of some
3 kB for each operation, and nothing looks at them afterwards: the buffers stand for results of what calls the loops. So the bodies
go, all but the largest, and what called one is a call of something unnamed, with the same operands and a result of the same shape.

Read and written here are protocol buffers (https://protobuf.dev/programming-guides/encoding) of openxla/xla: HloModuleProto and what
it holds (xla/service/hlo.proto), within CompilationResultProto (xla/service/cpu/executable.proto), within ExecutableAndOptionsProto
(xla/pjrt/proto/compile_options.proto), behind a head of JAX's own. Whatever is not named below is handed on as it is. Another
release may write otherwise: `kept_programs` keeps a program so only if it loads and answers, bit by bit, what the whole one does.
"""

import io
from collections.abc import Callable, Iterator
from typing import Any

import jax
from jax.experimental import serialize_executable


MODULE = (1, 1, 1)  # where the HloModuleProto lies: the executable, its module with a configuration, the module
COMPUTATIONS = 3  # of a module
INSTRUCTIONS, COMPUTATION_ID, IS_FUSED = 2, 5, 7  # of a computation
NAME, OPCODE, SHAPE, CALLED, ID, OPERANDS, AFTER, BODIES = 1, 2, 3, 28, 35, 36, 37, 38  # of an instruction
VARINT, FIXED64, BYTES, FIXED32 = 0, 1, 2, 5  # kinds of fields

Field = tuple[int, int, Any]  # number, kind, what it holds


def lean(written: bytes) -> bytes:
    """What `jax.experimental.serialize_executable.serialize` gives, with its executable `without_fused_bodies`.

    Raises whatever a release raises that writes otherwise.
    """

    class Taken:
        def __init__(self, executable: bytes) -> None:
            self.executable = executable

    class Reader(serialize_executable._JaxPjrtUnpickler):
        def persistent_load(self, pid: Any) -> Any:
            return Taken(without_fused_bodies(pid[1])) if pid[0] == "exec" else super().persistent_load(pid)

    class Writer(serialize_executable._JaxPjrtPickler):
        def persistent_id(self, obj: Any) -> Any:
            return ("exec", obj.executable) if isinstance(obj, Taken) else super().persistent_id(obj)

    client = jax.devices()[0].client
    parts = Reader(io.BytesIO(written), client, client.devices()).load()
    with io.BytesIO() as file:
        Writer(file).dump(parts)
        return file.getvalue()


def without_fused_bodies(executable: bytes) -> bytes:
    """An executable of XLA's CPU backend as JAX's client writes it. Raises ValueError where it is none."""
    length, begin = _varint(executable, 0)
    head = begin + length  # JAX's own
    return executable[:head] + _changed(executable[head:], MODULE, _lean_module)


def _changed(message: bytes, path: tuple[int, ...], change: Callable[[bytes], bytes]) -> bytes:
    """A message with what lies at the end of a path of fields changed."""
    if not path:
        return change(message)
    fields = list(_fields(message))
    if not any(number == path[0] and kind == BYTES for number, kind, _ in fields):
        raise ValueError(f"no field {path[0]} where XLA writes one")
    return _message(
        (number, kind, _changed(held, path[1:], change) if number == path[0] and kind == BYTES else held)
        for number, kind, held in fields
    )


def _lean_module(module: bytes) -> bytes:
    fields = [(n, kind, held, list(_fields(held)) if n == COMPUTATIONS else []) for n, kind, held in _fields(module)]
    bodies = {
        _held(parts, COMPUTATION_ID): parts
        for *_, parts in fields
        if any(part == IS_FUSED and value for part, _, value in parts)
    }
    # By the operations in it XLA tells whether a program is worth a thread of its own or runs while the caller waits.
    alone = {i: len(parts) for i, parts in bodies.items() if not any(map(_calls_a_body, _instructions(parts)))}
    stays = {max(alone, key=lambda i: alone[i])} if alone else set()
    kept: list[Field] = []
    for number, kind, held, parts in fields:
        own = _held(parts, COMPUTATION_ID) if parts else None
        if own is None or own in stays:
            kept.append((number, kind, held))
        elif own not in bodies:
            parts = [(p, k, _without_body(value, stays) if p == INSTRUCTIONS else value) for p, k, value in parts]
            kept.append((number, kind, _message(parts)))
    return _message(kept)


def _held(fields: list[Field], which: int) -> Any:
    for number, _, value in fields:
        if number == which:
            return value
    raise ValueError(f"no field {which} where XLA writes one")


def _instructions(computation: list[Field]) -> Iterator[bytes]:
    return (value for number, _, value in computation if number == INSTRUCTIONS)


def _calls_a_body(instruction: bytes) -> bool:
    return (OPCODE, BYTES, b"fusion") in _fields(instruction)


def _without_body(instruction: bytes, stays: set[int]) -> bytes:
    """A call of a fused body as that of something else, unless the body stays; any other instruction as it is."""
    if not _calls_a_body(instruction):
        return instruction
    fields = list(_fields(instruction))
    if _varint(_held(fields, BODIES), 0)[0] in stays:  # a list of one
        return instruction
    kept = [field for field in fields if field[0] in (NAME, SHAPE, ID, OPERANDS, AFTER)]
    return _message([*kept, (OPCODE, BYTES, b"custom-call"), (CALLED, BYTES, b"a fused loop")])


def _varint(data: bytes, at: int) -> tuple[int, int]:
    """(a number of seven bits a byte, the least first, where what follows begins)."""
    value = shift = 0
    while True:
        if at >= len(data):
            raise ValueError("a number without an end")
        byte = data[at]
        value |= (byte & 127) << shift
        at, shift = at + 1, shift + 7
        if byte < 128:
            return value, at


def _fields(message: bytes) -> Iterator[Field]:
    at = 0
    while at < len(message):
        tag, at = _varint(message, at)
        number, kind = tag >> 3, tag & 7
        if kind == VARINT:
            held, at = _varint(message, at)
            yield number, kind, held
            continue
        if kind == BYTES:
            length, at = _varint(message, at)
        elif kind in (FIXED64, FIXED32):
            length = 8 if kind == FIXED64 else 4
        else:
            raise ValueError(f"a field of kind {kind}")
        if not number or at + length > len(message):
            raise ValueError("a field without an end")
        yield number, kind, message[at : at + length]
        at += length


def _message(fields: Iterator[Field] | list[Field]) -> bytes:
    out = bytearray()
    for number, kind, held in fields:
        _put_varint(out, number << 3 | kind)
        if kind == VARINT:
            _put_varint(out, held)
            continue
        if kind == BYTES:
            _put_varint(out, len(held))
        out += held
    return bytes(out)


def _put_varint(out: bytearray, value: int) -> None:
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    out.append(value)

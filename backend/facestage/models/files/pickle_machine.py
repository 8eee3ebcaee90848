"""What a pickle says, kept as data: a machine for the stream's opcodes that looks up no name and
calls nothing.

A pickle is a program: every name in it is looked up and called, and its plain data can be a bomb
too (an index of the memo that asks for gigabytes, tuples as keys whose hash takes for ever or
overflows the stack). Here names and calls become records, and every opcode costs what its bytes do.

Formats: pickle protocols 0 to 5 (PEP 307, PEP 574); the opcodes' arguments are read by Python's own
pickletools.
"""

from __future__ import annotations

import codecs
import io
import pickletools
from collections.abc import Callable
from typing import Any

# A published model has some hundred opcodes, a file of landmarks some thousand.
OPCODE_LIMIT = 500_000
ENCODE = "_codecs.encode"
_KEY_LETTERS = 1000


class Name:
    """A name that the pickle wanted looked up."""

    __slots__ = ("full",)

    def __init__(self, full: str) -> None:
        self.full = full


class Record:
    """What a pickle wanted called or built: ``function`` with ``args``, and then given a state."""

    __slots__ = ("args", "function", "state")

    def __init__(self, function: Name, args: tuple[Any, ...]) -> None:
        self.function, self.args = function, args
        self.state: Any = None


def run(content: bytes, is_allowed: Callable[[str], bool]) -> Any:
    """The value that the pickle ``content`` describes, of Python's plain types, Name and Record.

    ``is_allowed`` says whether a full name may occur. Raises ValueError and what damaged bytes make
    decoders raise.
    """
    return _Machine(is_allowed).run(io.BytesIO(content))


class _Machine:
    def __init__(self, is_allowed: Callable[[str], bool]) -> None:
        self.is_allowed = is_allowed
        self.stack: list[Any] = []
        self.outer: list[list[Any]] = []  # stacks below the marks
        # A dictionary, so that a large index costs no more than a small one.
        self.memo: dict[int, Any] = {}

    def run(self, stream: io.BytesIO) -> Any:
        for _ in range(OPCODE_LIMIT):
            opcode = _OPCODES.get(stream.read(1))
            if opcode is None:
                raise ValueError("it is no pickle, or it is cut")
            name = opcode.name
            if name == "STOP":
                return self.stack.pop()
            argument = None
            if name == "STRING":
                argument = _text_of_python_2(stream)
            elif opcode.arg is not None:
                argument = opcode.arg.reader(stream)
            if name in _PUSHED:
                self.stack.append(argument)
            elif name in _CONSTANTS:
                self.stack.append(_CONSTANTS[name]())
            elif name not in _IGNORED:
                method = getattr(self, f"_{name.lower()}", None)
                if method is None:
                    raise ValueError(f"it uses {name}, which no array needs")
                method(argument)
        raise ValueError(f"it has more than {OPCODE_LIMIT} steps")

    def _mark(self, _argument: Any) -> None:
        self.outer.append(self.stack)
        self.stack = []

    def _since_mark(self) -> list[Any]:
        items, self.stack = self.stack, self.outer.pop()
        return items

    def _pop(self, _argument: Any) -> None:
        if self.stack:
            self.stack.pop()
        else:
            self._since_mark()

    def _pop_mark(self, _argument: Any) -> None:
        self._since_mark()

    def _dup(self, _argument: Any) -> None:
        self.stack.append(self.stack[-1])

    def _put(self, index: int) -> None:
        if not 0 <= index < OPCODE_LIMIT:
            raise ValueError(f"its memo has the index {index}")
        self.memo[index] = self.stack[-1]

    _binput = _long_binput = _put

    def _memoize(self, _argument: Any) -> None:
        self.memo[len(self.memo)] = self.stack[-1]

    def _get(self, index: int) -> None:
        self.stack.append(self.memo[index])

    _binget = _long_binget = _get

    def _tuple(self, _argument: Any) -> None:
        items = self._since_mark()
        self.stack.append(tuple(items))

    def _tuple1(self, _argument: Any) -> None:
        self.stack[-1:] = [(self.stack[-1],)]

    def _tuple2(self, _argument: Any) -> None:
        self.stack[-2:] = [(self.stack[-2], self.stack[-1])]

    def _tuple3(self, _argument: Any) -> None:
        self.stack[-3:] = [(self.stack[-3], self.stack[-2], self.stack[-1])]

    def _list(self, _argument: Any) -> None:
        items = self._since_mark()
        self.stack.append(items)

    def _append(self, _argument: Any) -> None:
        item = self.stack.pop()
        _expect(self.stack[-1], list).append(item)

    def _appends(self, _argument: Any) -> None:
        items = self._since_mark()
        _expect(self.stack[-1], list).extend(items)

    def _dict(self, _argument: Any) -> None:
        items = self._since_mark()
        self.stack.append({})
        self._fill(items)

    def _setitem(self, _argument: Any) -> None:
        items = self.stack[-2:]
        del self.stack[-2:]
        self._fill(items)

    def _setitems(self, _argument: Any) -> None:
        self._fill(self._since_mark())

    def _fill(self, items: list[Any]) -> None:
        """Put keys and values into the dictionary on the stack; what is set on a record is of no
        use here.
        """
        target = self.stack[-1]
        if isinstance(target, Record):
            return
        _expect(target, dict)
        for key, value in zip(items[::2], items[1::2], strict=True):
            target[_plain(key)] = value

    def _additems(self, _argument: Any) -> None:
        items = self._since_mark()
        _expect(self.stack[-1], set).update(map(_plain, items))

    def _frozenset(self, _argument: Any) -> None:
        items = self._since_mark()
        self.stack.append(frozenset(map(_plain, items)))

    def _global(self, argument: str) -> None:
        self._name(*argument.split(" ", 1))

    def _stack_global(self, _argument: Any) -> None:
        name, module = self.stack.pop(), self.stack.pop()
        self._name(_expect(module, str), _expect(name, str))

    def _name(self, module: str, name: str) -> None:
        full = f"{module}.{name}"
        if not self.is_allowed(full):
            raise ValueError(f"it asks for '{full[:80]}', which holds no array")
        self.stack.append(Name(full))

    def _reduce(self, _argument: Any) -> None:
        args, function = self.stack.pop(), self.stack.pop()
        self._call(function, args)

    _newobj = _reduce

    def _newobj_ex(self, _argument: Any) -> None:
        self.stack.pop()
        self._reduce(None)

    def _inst(self, argument: str) -> None:
        args = tuple(self._since_mark())
        self._global(argument)
        self._call(self.stack.pop(), args)

    def _obj(self, _argument: Any) -> None:
        function, *args = self._since_mark()
        self._call(function, tuple(args))

    def _call(self, function: Any, args: Any) -> None:
        self.stack.append(Record(_expect(function, Name), _expect(args, tuple)))

    def _build(self, _argument: Any) -> None:
        state = self.stack.pop()
        _expect(self.stack[-1], Record).state = state


def _expect(value: Any, kind: type) -> Any:
    if type(value) is not kind:
        raise ValueError(f"it treats a {type(value).__name__} as a {kind.__name__.lower()}")
    return value


def _plain(key: Any) -> Any:
    """``key``, when its hash is cheap; Python 3 writes bytes for Python 2 as a call."""
    if type(key) is Record and key.function.full == ENCODE and len(key.args[0]) <= _KEY_LETTERS:
        return str(key.args[0]).encode("latin-1")
    if type(key) not in (str, bytes, int, float, bool, type(None)):
        raise ValueError(f"it has a {type(key).__name__} as a key")
    return key


def _text_of_python_2(stream: io.BytesIO) -> str:
    """The argument of STRING: pickletools of older Pythons takes ASCII alone for it."""
    line = stream.readline().rstrip(b"\r\n")
    if len(line) < 2 or line[:1] != line[-1:] or line[:1] not in (b"'", b'"'):
        raise ValueError("it has a text without quotes")
    return codecs.escape_decode(line[1:-1])[0].decode("latin-1")  # type: ignore[attr-defined]


_OPCODES = {opcode.code.encode("latin-1"): opcode for opcode in pickletools.opcodes}
_PUSHED = {
    "INT",
    "BININT",
    "BININT1",
    "BININT2",
    "LONG",
    "LONG1",
    "LONG4",
    "STRING",
    "BINSTRING",
    "SHORT_BINSTRING",
    "BINBYTES",
    "SHORT_BINBYTES",
    "BINBYTES8",
    "BYTEARRAY8",
    "UNICODE",
    "SHORT_BINUNICODE",
    "BINUNICODE",
    "BINUNICODE8",
    "FLOAT",
    "BINFLOAT",
}
_CONSTANTS: dict[str, Callable[[], Any]] = {
    "NONE": lambda: None,
    "NEWTRUE": lambda: True,
    "NEWFALSE": lambda: False,
    "EMPTY_LIST": list,
    "EMPTY_DICT": dict,
    "EMPTY_TUPLE": tuple,
    "EMPTY_SET": set,
}
_IGNORED = {"PROTO", "FRAME", "READONLY_BUFFER"}

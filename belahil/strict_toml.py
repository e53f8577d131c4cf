"""TOML files that say in one line what is wrong: which table, which key, what is allowed.

The shape of a file is a tree of `Strict` tables. `parse` turns text into plain tables, `typed` turns those
into the tree, and every refusal is a `ConfigError` that begins with the name of the file.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin

import msgspec
from msgspec import Meta, Struct

from belahil.errors import ConfigError

Positive = Annotated[float, Meta(gt=0)]
NotNegative = Annotated[float, Meta(ge=0)]


class Strict(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=False):
    """A table that accepts only the keys it names."""


Tree = TypeVar("Tree", bound=Strict)


def read(path: str | Path, what: str) -> str:
    """Return the text of a file.

    Parameters
    ----------
    path : str or Path
        Where it is.
    what : str
        How to call it in a refusal: "bench file".

    Raises
    ------
    ConfigError
        It cannot be opened, or is not text.
    """
    try:
        return Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else "not a text file"
        raise ConfigError(f"{what} {path}: cannot be read ({reason})") from error


def parse(text: str, name: str) -> dict[str, Any]:
    """Return the tables of a TOML text, unchecked.

    Raises
    ------
    ConfigError
        It is no TOML.
    """
    try:
        tables: dict[str, Any] = msgspec.toml.decode(text.encode())
    except msgspec.DecodeError as error:
        raise ConfigError(f"{name}: not valid TOML ({error})") from error
    return tables


def typed(tables: dict[str, Any], tree: type[Tree], name: str) -> Tree:
    """Return plain tables as the tree they should be.

    Parameters
    ----------
    tables : dict
        As from `parse`.
    tree : type
        A `Strict` table with the tables below it.
    name : str
        Of the file, for the refusal.

    Raises
    ------
    ConfigError
        A key that is unknown, or a value of the wrong kind or outside its range.
    """
    try:
        return msgspec.convert(tables, type=tree)
    except msgspec.ValidationError as error:
        raise ConfigError(_one_line(f"{name}: {_explained(str(error), tree)}")) from error


@contextmanager
def about(name: str) -> Iterator[None]:
    """Put the name of the file before what a check refuses."""
    try:
        yield
    except ConfigError as error:
        raise ConfigError(_one_line(f"{name}: {error}")) from error


def _one_line(message: str) -> str:
    """Take line breaks out, which a quoted value may have brought."""
    return " ".join(message.split())


def numbers(table: Strict, where: str = "") -> list[tuple[str, tuple[float, ...]]]:
    """List the dotted name and the numbers of every key that holds a float or a row of them."""
    found: list[tuple[str, tuple[float, ...]]] = []
    for key in table.__struct_fields__:
        value = getattr(table, key)
        if isinstance(value, Strict):
            found += numbers(value, f"{where}{key}.")
        elif isinstance(value, float):
            found.append((where + key, (value,)))
        elif isinstance(value, tuple):
            found.append((where + key, value))
    return found


def as_text(tree: Strict, without: Iterable[str] = ()) -> str:
    """Write every key that has a value, but tables `without`; `parse` and `typed` give the same tree back."""
    import tomli_w

    tables = _without_none(msgspec.to_builtins(tree))
    for table in without:
        del tables[table]
    return tomli_w.dumps(tables)


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    if isinstance(value, list | tuple):
        return [_without_none(item) for item in value]
    return value


_UNKNOWN = re.compile(r"Object contains unknown field `(?P<key>[^`]*)`(?: - at `\$\.?(?P<path>[^`]*)`)?")
_AT = re.compile(r"^(?P<what>.*?)(?: - at `\$\.?(?P<path>[^`]*)`)?$")
_ENUM = re.compile(r"Invalid enum value (?P<value>.*)")


_KINDS = {
    "object": "a table",
    "array": "a list",
    "str": "text",
    "float": "a number",
    "int": "a whole number",
    "bool": "true or false",
}


def _in_words(match: re.Match[str]) -> str:
    """Name the kinds of a TOML value as its writer does; nobody can write a null."""
    return " or ".join(
        _KINDS.get(kind, kind) for kind in (match[1] or match[2]).split(" | ") if kind != "null"
    )


def _explained(message: str, tree: type[Strict]) -> str:
    message = re.sub(r"(?<=xpected )`([a-z| ]+)`|(?<=got )`([a-z]+)`", _in_words, message)
    unknown = _UNKNOWN.fullmatch(message)
    if unknown:
        path = unknown["path"] or ""
        allowed = ", ".join(field.name for field in msgspec.structs.fields(_table_at(tree, path)))
        place = f"[{path}] has an" if path else "there is an"
        return f"{place} unknown key `{unknown['key']}`; allowed: {allowed}"
    known = _AT.fullmatch(message)
    if not known or not known["path"]:
        return message
    table, _, key = known["path"].rpartition(".")
    what = known["what"][0].lower() + known["what"][1:]
    word = _ENUM.fullmatch(known["what"])
    if word:
        words = ", ".join(_words_at(tree, table, key))
        return f"{f'[{table}] ' if table else ''}{key} = {word['value']} is unknown; allowed: {words}"
    return f"{f'[{table}] ' if table else ''}{key}: {what}"


def _annotations(table: type[Struct]) -> dict[str, Any]:
    return {field.name: field.type for field in msgspec.structs.fields(table)}


def _table_at(tree: type[Strict], path: str) -> type[Struct]:
    table: type[Struct] = tree
    for key in filter(None, re.sub(r"\[[^]]*\]", "", path).split(".")):
        annotation = _annotations(table)[key]
        choices = get_args(annotation) or (annotation,)
        table = next(choice for choice in choices if isinstance(choice, type) and issubclass(choice, Struct))
    return table


def _words_at(tree: type[Strict], path: str, key: str) -> tuple[str, ...]:
    annotation = _annotations(_table_at(tree, path))[key]
    choices = (annotation, *get_args(annotation))
    return next(get_args(choice) for choice in choices if get_origin(choice) is Literal)

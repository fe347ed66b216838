"""Conditions on the attributes of points, such as ``intensity > 40 and user_data in (2, 9)``.

Python's own parser reads the text, and only a short list of syntax nodes is accepted. No text is
executed as code, so an expression from a web form can do no harm.
"""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable, Mapping
from enum import Enum
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from toolbox.errors import DataError

LONGEST = 10_000  # characters, since the parser of Python is recursive
DEEPEST = 100  # levels, since the functions below are recursive, too
TOO_DEEP = f"is nested more than {DEEPEST} levels deep"

BINARY: Mapping[type[ast.AST], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Mod: operator.mod,
    ast.Pow: operator.pow,
}
COMPARE: Mapping[type[ast.AST], Callable[[Any, Any], Any]] = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.In: np.isin,
    ast.NotIn: lambda value, members: ~np.isin(value, members),
}
FUNCTIONS: Mapping[str, np.ufunc] = {
    "abs": np.abs,
    "sqrt": np.sqrt,
    "floor": np.floor,
    "isnan": np.isnan,
    "minimum": np.minimum,
    "maximum": np.maximum,
}


class Expression(str):
    """A condition on attributes: checked when it is made, and evaluated on points later.

    It may contain attribute names, numbers, ``+ - * / % **``, comparisons (also chained), ``in``
    with a list, ``and``, ``or``, ``not``, and the functions abs, sqrt, floor, isnan, minimum and
    maximum.

    Examples
    --------
    >>> condition = Expression("intensity > 40 and classification in (2, 6)")
    >>> sorted(condition.names)
    ['classification', 'intensity']
    >>> condition.mask({"intensity": np.array([50, 50]), "classification": np.array([2, 5])}, 2)
    array([ True, False])
    """

    tree: ast.expr

    def __new__(cls, text: str) -> Expression:
        """Parse a text.

        Raises
        ------
        ValueError
            It is not a condition, or contains anything that is not listed above.
        """
        made = super().__new__(cls, text)
        made.tree = _parsed(text)
        return made

    @property
    def names(self) -> frozenset[str]:
        """The attributes that the expression needs."""
        called = {id(node.func) for node in ast.walk(self.tree) if isinstance(node, ast.Call)}
        return frozenset(
            node.id
            for node in ast.walk(self.tree)
            if isinstance(node, ast.Name) and id(node) not in called
        )

    def mask(self, columns: Mapping[str, NDArray[Any]], size: int) -> NDArray[np.bool_]:
        """Evaluate the condition for each point.

        Parameters
        ----------
        columns : arrays of shape (size,) by attribute name, for every name in `names`
        size : number of points

        Returns
        -------
        array of shape (size,)

        Raises
        ------
        DataError
            An attribute has several values per point.
        """
        # Attributes are compared as float64: uint8 arithmetic would wrap without a word.
        wide = {name: np.asarray(columns[name], np.float64) for name in self.names}
        for name, column in wide.items():
            if column.shape != (size,):
                raise DataError(f"attribute {name!r} has several values per point")
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            value = _value(self.tree, wide)
        return np.broadcast_to(_truth(value), (size,))


_ONE_EQUAL = re.compile(r"(?<![=<>!])=(?!=)")


def _parsed(text: str) -> ast.expr:
    if len(text) > LONGEST:
        raise ValueError(f"an expression has at most {LONGEST} characters, got {len(text)}")
    try:
        tree = ast.parse(text.strip(), mode="eval").body
        is_condition = _sort(tree) is Sort.TRUTH or isinstance(tree, ast.Name)
    except SyntaxError as err:
        hint = "write conditions such as 'intensity > 40 and user_data == 3'"
        if _ONE_EQUAL.search(text):
            hint = "write == where values are to be equal, such as 'user_data == 3'"
        raise ValueError(f"cannot be read ({err.msg}); {hint}") from None
    except (RecursionError, MemoryError):  # of the parser, or when a node is shown as text
        raise ValueError(TOO_DEEP) from None
    if not is_condition:
        raise ValueError("must be a condition, such as 'intensity > 40'")
    return tree


class Sort(Enum):
    """The type of a node of an expression."""

    NUMBER = "a number"
    TRUTH = "true or false"


def _sort(node: ast.expr, depth: int = 0) -> Sort:  # noqa: PLR0911, PLR0912  one case per node
    """Find the type of a node, or refuse it: it is not allowed, or its operands do not fit."""
    if depth > DEEPEST:
        raise ValueError(TOO_DEEP)

    def need(sort: Sort, *operands: ast.expr) -> None:
        for operand in operands:
            if (found := _sort(operand, depth + 1)) is not sort:
                raise ValueError(f"{ast.unparse(operand)} is {found.value}, not {sort.value}")

    match node:
        case ast.Name():
            return Sort.NUMBER
        case ast.Constant() if _is_plain_number(node):
            return Sort.NUMBER
        case ast.UnaryOp(op=ast.Not()):
            _sort(node.operand, depth + 1)
            return Sort.TRUTH
        case ast.UnaryOp(op=ast.USub() | ast.UAdd()):
            need(Sort.NUMBER, node.operand)
            return Sort.NUMBER
        case ast.BinOp() if type(node.op) in BINARY:
            need(Sort.NUMBER, node.left, node.right)
            return Sort.NUMBER
        case ast.BoolOp():
            for operand in node.values:
                _sort(operand, depth + 1)
            return Sort.TRUTH
        case ast.Compare():
            need(Sort.NUMBER, node.left)
            if len(node.ops) > 1 and any(isinstance(op, ast.In | ast.NotIn) for op in node.ops):
                raise ValueError("'in' cannot stand in a chain; use 'and'")
            for op, right in zip(node.ops, node.comparators, strict=True):
                _check_comparison(op, right, need)
            return Sort.TRUTH
        case ast.Call(func=ast.Name(id=name)) if name in FUNCTIONS and not node.keywords:
            if len(node.args) != FUNCTIONS[name].nin:
                raise ValueError(f"{name} takes {FUNCTIONS[name].nin} values")
            need(Sort.NUMBER, *node.args)
            return Sort.TRUTH if name == "isnan" else Sort.NUMBER
        case ast.Call():
            raise ValueError(f"only these functions may be called: {', '.join(FUNCTIONS)}")
    raise ValueError(f"{ast.unparse(node)} is not allowed")


def _check_comparison(op: ast.cmpop, right: ast.expr, need: Callable[..., None]) -> None:
    if type(op) not in COMPARE:
        raise ValueError("'is' is not allowed; use ==")
    if not isinstance(op, ast.In | ast.NotIn):
        need(Sort.NUMBER, right)
        return
    items = right.elts if isinstance(right, ast.Tuple | ast.List) else [right]
    if not items or not all(_is_plain_number(item) for item in items):
        raise ValueError(f"'in' takes a list of numbers, such as (2, 9), not {ast.unparse(right)}")


def _is_plain_number(node: ast.expr) -> bool:
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        node = node.operand
    if not (isinstance(node, ast.Constant) and isinstance(node.value, int | float)):
        return False
    try:
        return math.isfinite(float(node.value))
    except OverflowError:
        return False


def _value(node: ast.expr, columns: Mapping[str, NDArray[np.float64]]) -> Any:  # noqa: PLR0911
    match node:
        case ast.Name():
            return columns[node.id]
        case ast.Constant():
            assert isinstance(node.value, int | float)  # _sort has seen to that
            return np.float64(node.value)  # no integers of unbounded size: 9 ** 9 ** 9 is inf
        case ast.Tuple() | ast.List():
            return [_value(item, columns) for item in node.elts]
        case ast.BinOp():
            left, right = _value(node.left, columns), _value(node.right, columns)
            return BINARY[type(node.op)](left, right)
        case ast.UnaryOp(op=ast.Not()):
            return ~_truth(_value(node.operand, columns))
        case ast.UnaryOp(op=ast.USub()):
            return -_value(node.operand, columns)
        case ast.UnaryOp():
            return _value(node.operand, columns)
        case ast.BoolOp():
            truths = [_truth(_value(operand, columns)) for operand in node.values]
            return reduce(operator.and_ if isinstance(node.op, ast.And) else operator.or_, truths)
        case ast.Compare():
            return _compared(node, columns)
        case ast.Call(func=ast.Name(id=name)):
            return FUNCTIONS[name](*[_value(argument, columns) for argument in node.args])
    raise AssertionError(f"_sort let {node!r} through")


def _compared(node: ast.Compare, columns: Mapping[str, NDArray[np.float64]]) -> Any:
    """Evaluate a comparison; a chain such as 1 < a <= 5 is true where each of its pairs is."""
    values = [_value(item, columns) for item in [node.left, *node.comparators]]
    pairs = [COMPARE[type(op)](values[i], values[i + 1]) for i, op in enumerate(node.ops)]
    return reduce(operator.and_, pairs)


def _truth(value: Any) -> NDArray[np.bool_]:
    """Turn numbers into truth values; NaN counts as false, as in every comparison."""
    array = np.asarray(value)
    return array if array.dtype == bool else (array != 0) & ~np.isnan(array)

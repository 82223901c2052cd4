# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Parameters by name, of the kind that is wanted; what they make is refused in the words that were typed."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from stickslip_ros.errors import InvalidParameterError


class ParameterValues:
    """See the module.

    Parameters
    ----------
    get : gives the value of a parameter by its name.
    typed : the name that a parameter was given by, where that is another one.
    """

    def __init__(self, get: Callable[[str], Any], typed: Callable[[str], str] = str) -> None:
        self._get, self._typed = get, typed

    def __getitem__(self, name: str) -> Any:
        return self._get(name)

    def number(self, name: str) -> float:
        """A number, which may be infinite or NaN.

        Raises
        ------
        InvalidParameterError
            If it is none.
        """
        found = self._get(name)
        if isinstance(found, bool) or not isinstance(found, (int, float)):
            raise InvalidParameterError(name, "a number", found)
        try:
            return float(found)
        except OverflowError as error:
            raise InvalidParameterError(name, "a number below 1e308", "an integer of too many digits") from error

    def number_if_set(self, name: str) -> float | None:
        """A finite number, None where it is NaN: not set.

        Raises
        ------
        InvalidParameterError
            If it is none.
        """
        found = self.number(name)
        if math.isinf(found):
            raise InvalidParameterError(name, "finite, or nan where it is not set", found)
        return None if math.isnan(found) else found

    def flag(self, name: str) -> bool:
        """Yes or no.

        Raises
        ------
        InvalidParameterError
            If it is neither: the text "false" would count as true.
        """
        found = self._get(name)
        if not isinstance(found, bool):
            raise InvalidParameterError(name, "true or false", found)
        return found

    @contextmanager
    def refused_as_typed(self, names: Mapping[str, tuple[str, ...]]) -> Iterator[None]:
        """Let what is refused inside have the names and values that the user gave.

        Parameters
        ----------
        names : of fields, to those of the parameters that each is made of; a parameter's own name needs no entry.
        """
        try:
            yield
        except InvalidParameterError as error:
            parameters = names.get(error.name, (error.name,))
            values = [self._get(name) for name in parameters] if error.name in names else ()
            raise error.as_typed([self._typed(name) for name in parameters], values) from error

"""A term that a law of another form adds to the laws of this package; compiled for the form that declares it.

The laws of a reducer's contacts hold a F - c F ln F + k F^m each, and at most one further form among them: pins and
output contacts follow the law that the study names, bearings behind them have their powers.
"""

from typing import Any, ClassVar, NamedTuple

import numpy as np
from numba.core import types
from numba.extending import overload
from numpy.typing import ArrayLike

from pipeline.model.compiled import ALGEBRA, BORROWED, INLINED, algebraic_part
from pipeline.model.geometry.cycloid_profile import Real


class _Numbers(NamedTuple):
    numbers: Real
    factor: Real
    unit: Real


class FurtherTerm(_Numbers):
    """Deflections ``factor * form(numbers, F / unit)`` [mm] of ``n`` contacts under the forces F [N].

    A law of another form is a subclass that declares `COLUMNS` and three static functions of its numbers (n_numbers,
    ...) and of F > 0: ``form``, which rises and is concave from 0 at F = 0; ``slope``, its derivative; ``energy``, its
    integral from 0. The solver compiles the first two.

    Attributes
    ----------
    COLUMNS : unit and meaning of each number by its column in the table of coefficients.
    numbers : (n_numbers, n), any where the factor is 0.
    factor : (n,), 0 for a contact without the term.
    unit : (n,) force [N] that counts as 1 N.
    """

    __slots__ = ()
    COLUMNS: ClassVar[dict[str, tuple[str, str]]] = {}

    @staticmethod
    def form(numbers: Any, force: Any) -> Any:
        """Deflection [mm] of the form, one that has no numbers: none."""
        return 0.0 * force

    @staticmethod
    def slope(numbers: Any, force: Any) -> Any:
        """Its derivative [mm/N]."""
        return 0.0 * force

    @staticmethod
    def energy(numbers: Any, force: Any) -> Any:
        """Its integral over the force from 0 [N mm]."""
        return 0.0 * force

    @classmethod
    def of(cls, *numbers: Real) -> "FurtherTerm":
        """The term of contacts with these numbers (n,) each, in the order of `COLUMNS`."""
        shape = numbers[0].shape
        return cls(np.array(numbers, dtype=float), np.ones(shape), np.ones(shape))

    def some(self, index: Any) -> "FurtherTerm":
        """The term of some contacts."""
        numbers = np.atleast_2d(self.numbers.T[index]).T
        return type(self)(numbers, np.atleast_1d(self.factor[index]), np.atleast_1d(self.unit[index]))

    def scaled(self, factor: ArrayLike) -> "FurtherTerm":
        """The term with ``factor``, one or (n,), times the deflection under any force."""
        return type(self)(self.numbers, np.multiply(factor, self.factor), self.unit)

    def stiffened(self, factor: Real) -> "FurtherTerm":
        """The term with the deflection that it has under a force that is ``factor`` (..., n) times smaller."""
        return type(self)(self.numbers, self.factor + np.zeros_like(factor), factor * self.unit)

    def deflection(self, force: Real) -> Real:
        """Deflection [mm] under ``force`` (..., n) [N] that is not negative."""
        return self.factor * self._of_contacts(self.form, force)

    def compliance(self, force: Real) -> Real:
        """Tangent of the deflection [mm/N]."""
        return self.factor / self.unit * self._of_contacts(self.slope, force)

    def complementary_energy(self, force: Real) -> Real:
        """Integral of the deflection over the force from 0 [N mm]."""
        return self.factor * self.unit * self._of_contacts(self.energy, force)

    def _of_contacts(self, function: Any, force: Real) -> Real:
        with np.errstate(all="ignore"):  # of contacts without the term
            return np.where(self.factor != 0, function(self.numbers, force / self.unit), 0.0)


def joined_terms(terms: list[FurtherTerm | None], contacts: list[int]) -> FurtherTerm | None:
    """The terms of groups of so many contacts each as one; None if none of them has any.

    Raises
    ------
    ValueError
        If they have two forms.
    """
    forms = {type(term): term for term in terms if term is not None}
    if not forms:
        return None
    if len(forms) > 1:
        raise ValueError(f"contacts of one reducer follow at most one further form, not {len(forms)}")
    ((form, term),) = forms.items()
    neutral_terms = (form(np.ones((len(term.numbers), n)), np.zeros(n), np.ones(n)) for n in contacts)
    groups = [neutral if group is None else group for group, neutral in zip(terms, neutral_terms, strict=True)]
    return form(*(np.concatenate(parts, axis=-1) for parts in zip(*groups, strict=True)))


def terms_in_series(term: FurtherTerm | None, second: FurtherTerm | None) -> FurtherTerm | None:
    """The term of contacts in series, of which one alone may have it.

    Raises
    ------
    ValueError
        If both have one that is not the same but for its factor.
    """
    if term is None or second is None:
        return term or second
    equal_numbers = all(map(np.array_equal, (term.numbers, term.unit), (second.numbers, second.unit)))
    if type(term) is not type(second) or not equal_numbers:
        raise ValueError("further terms of other numbers are no such term in series")
    return type(term)(term.numbers, term.factor + second.factor, term.unit)


def further(term, i, force):
    """Deflection and compliance that the further term adds at contact i: compiled code alone calls it."""
    return term.deflection(force)[i], term.compliance(force)[i]


# Inlined before it is compiled: as a function its code would depend on which entry points were read from the cache.
OPTIONS: Any = {"fastmath": ALGEBRA, **INLINED, **BORROWED}


@overload(further, jit_options=OPTIONS, inline="always")
def _compiled_further(term, i, force):
    if isinstance(term, types.NoneType):
        return lambda term, i, force: (0.0, 0.0)
    form, slope = algebraic_part(term.instance_class.form), algebraic_part(term.instance_class.slope)

    def added(term, i, force):
        if term.factor[i] == 0.0:
            return 0.0, 0.0
        numbers, share = term.numbers[:, i], force / term.unit[i]
        return term.factor[i] * form(numbers, share), term.factor[i] / term.unit[i] * slope(numbers, share)

    return added

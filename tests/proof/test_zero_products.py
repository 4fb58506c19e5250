"""Products that are zero have a shape, however they are multiplied."""

from polefence.proof.polynomials import Polynomial, monomials


def test_a_product_that_is_zero_keeps_its_shape() -> None:
    sizes = (2, 2, 2)
    zero, threes = (
        Polynomial({e: [[x] * 6 for _ in range(6)] for e in monomials(sizes, 2)}, sizes, (2, 2, 2))
        for x in (0, 3)
    )
    product = zero * threes
    assert product.shape == (6, 6)
    assert not any(any(row) for M in product.terms.values() for row in M)

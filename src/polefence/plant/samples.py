"""The claim that a plant is the samples of another."""

from __future__ import annotations

from polefence.base.errors import InputError
from polefence.plant.exact import bare_plant, matrices_of
from polefence.plant.family import UncertainPlant
from polefence.proof.claims.samples import Samples


def claim_of_samples(plant: UncertainPlant) -> Samples:
    """Return the claim that a plant is the samples of another."""
    sampling = plant.sampling
    if sampling is None:
        raise InputError(f"{plant.name} is not a sampled plant")
    A, B, E = matrices_of(sampling.plant)
    return Samples(
        bare_plant(plant),
        A,
        B,
        E,
        sampling.delay,
        sampling.terms,
        sampling.units,
        sampling.early,
        None if sampling.plant.remainder is None else sampling.plant.remainder.source,
    )

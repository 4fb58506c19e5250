from polefence.conditions.linear import Index
from polefence.plant.system import Array

def instructions() -> str: ...
def run(
    unknowns: int,
    entries: Index,
    families: list[list[tuple[Array, Array, Array, Index, Array]]],
    x: Array,
    r: float,
    tolerance: float,
    enough: float,
    order: int,
    max_iterations: int,
    plain: bool = False,
) -> tuple[bool, Array, float, Array, float, int, bool]: ...

r"""From theory to data: each condition builds a `Pencil`, r D(x) - M(x) > 0.

======================  =======================  ====================  ==========================
condition               Lyapunov matrix          gain                  blocks (N vertices)
======================  =======================  ====================  ==========================
`parameter_dependent`   W(alpha), degree g       K(alpha) = Z(alpha)   monomials of degree g+1+d
                                                 W(alpha)^-1           in each simplex
\- ``quadratic``        g = 0, d = 0             K = Z W^-1            N
\- ``scheduled``        g = 1, d = 1             as above              N + N (N-1)
                                                                       + N (N-1) (N-2) / 6
`slack`                 P(alpha), degree g       K = L G^-1            monomials of degree
                                                                       max(g, 1) + d
\- ``slack``            g = 1, d = 0             as above              N
`lyapunov`              of a law given           given                 as its degrees say
======================  =======================  ====================  ==========================
"""

from polefence.lmi.conditions.methods import METHODS, Method, Scheduled, Slack, build
from polefence.lmi.conditions.pencil import Block, Linear, Pencil, Term, Variable
from polefence.lmi.conditions.target import Patch, Side, Target
from polefence.plant.boxes import Box
from polefence.plant.motion import Motion, Move

__all__ = [
    "METHODS",
    "Block",
    "Box",
    "Linear",
    "Method",
    "Motion",
    "Move",
    "Patch",
    "Pencil",
    "Scheduled",
    "Side",
    "Slack",
    "Target",
    "Term",
    "Variable",
    "build",
]

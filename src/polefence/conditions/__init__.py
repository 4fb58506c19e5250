r"""From theory to data: each condition builds a `Pencil`, r D(x) - M(x) > 0.

==============  ======================  =========================  =====================
name            Lyapunov matrix         gain                       blocks (N vertices)
==============  ======================  =========================  =====================
``quadratic``   W                       K = Z W^-1                 N
``slack``       P(alpha) affine         K = L G^-1                 N
``scheduled``   W(alpha) affine         K(alpha) = Z(alpha)        N + N (N-1)
                                        W(alpha)^-1                + N (N-1) (N-2) / 6
==============  ======================  =========================  =====================
"""

"""Search for points of conditions: scaling, interior points, bisection. Proves nothing."""

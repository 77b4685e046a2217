"""Reference planners: methods from outside the papers, for comparison with the papers' planners.

- `exact`, `tangents`, `ref_exact`: the exact optimum of J among discs (tangent graph).
- `ref_visibility`: visibility graph among discs and polygons.
- `ref_grid`: A* and Theta* on a lattice.
- `ref_cma`, `ref_ompl`: CMA-ES, Informed RRT* and BIT* from their libraries.
"""

"""What is seen: a run as a Rerun recording, and as a film.

Rerun comes with the `view` extra and what writes films with `film`; whoever begins to use one asks
`extras.need` for it first.
"""

"""Proof on concealed data: a truth generator of its own, sealed cases, and the scores of a diagnosis on them.

Nothing here imports the physics terms or the inference: the truth is flown by other equations of motion than those
that explain it. Only sea-water density, which belongs to neither, is shared.
"""

"""The sim-to-real gap: where it lies, which effect causes it, how far the effect shrinks it.

Nothing is exported yet. What will live here: the catalogue of effects (one file each, a user's
own included), the screening that names the effect or says that these data cannot tell, and the
blind check on measurements whose effect is withheld.
"""

__all__: list[str] = []

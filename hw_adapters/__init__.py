"""Instruments, real and virtual: protocols, capture sequences, wire-level stand-ins.

Nothing is exported yet. What will live here: the protocols `Spectrometer`, `MultispectralSensor`,
`LightSource`, `BackgroundStage` and `Bench`, their implementations on the twin and on real
drivers, and the stand-ins that feed unmodified driver libraries. Each returns a measurement of
`twin`, so an estimator cannot tell which of them took it. Until then `benchtwin simulate` asks
`twin` for its captures directly.
"""

__all__: list[str] = []

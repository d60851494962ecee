"""A local page on which a person moves a material and a bench and sees what that changes.

`benchtwin explore` opens it. `source` says what is explored, `model` computes one picture from
the positions of the sliders, `contours` the appearance map behind it, `figures` draws both as
plain values for plotly; `page`, `app` and `server` put them before a person.
"""

__all__: list[str] = []

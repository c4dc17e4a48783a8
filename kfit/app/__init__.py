"""The local page: a picture in, a box around the object, the fit as it converges, the answer out."""

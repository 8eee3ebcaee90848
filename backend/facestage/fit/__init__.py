"""The fit: an energy of photo, landmarks and priors, minimised by damped Gauss-Newton in stages.

May import the contract, models, render, numpy and scipy. Symbols follow Dib et al. 2019.
"""

"""How well is each parameter of a fit known, beyond its covariance?"""

"""What any triangle mesh can be asked: nearest points, smooth functions, a chart, bent joints.

May import the contract, numpy and scipy.
"""

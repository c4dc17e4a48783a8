"""Whole data sets through one fit, under Lightning's strategies; interrupted runs go on."""

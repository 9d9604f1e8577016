"""The validation of the published twin made again: Sekkat et al., Heliyon (2024).

Its public names are in `pepper_kin.model`, `pepper_kin.twin` and `pepper_kin.jobs`.
"""

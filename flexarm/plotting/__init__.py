"""Figures: results over time, frequency responses, free decays; and in ``wiring`` the block diagram of a scenario."""

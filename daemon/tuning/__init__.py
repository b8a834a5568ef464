"""Measures a hovering vehicle by small pulses, and proposes the gains that follow."""

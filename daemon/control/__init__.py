"""From state and reference to body rates and thrust; pure."""

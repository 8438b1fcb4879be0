"""The paper's Table II."""

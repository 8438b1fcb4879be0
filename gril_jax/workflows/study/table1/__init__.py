"""The paper's Table I and Figure 2."""

"""The paper's tables, figures and clips from finished runs."""

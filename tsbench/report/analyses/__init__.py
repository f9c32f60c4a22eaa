"""The paper's analyses: each a pure function from stored runs to a table, and a figure where it is one."""

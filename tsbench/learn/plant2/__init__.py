"""`plant2`: a transformer over object tokens (PlanT 2.0, arXiv 2511.07292), and `plant2-ft`, which reads signs."""

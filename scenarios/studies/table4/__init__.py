"""The paper's Table IV: what its lift column can tell, and what it cannot."""

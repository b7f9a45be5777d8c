"""Many runs: studies, sweeps, error budgets."""

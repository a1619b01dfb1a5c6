"""Whether an estimator's confidence is honest: stated covariances against true scatter over noise seeds."""

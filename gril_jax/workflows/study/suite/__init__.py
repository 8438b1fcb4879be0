"""A suite of tasks from films to policies: one reward, one learner, one table."""

"""The steps of the stage `train`: the plan, what is fitted to the cameras, and the training of a group."""

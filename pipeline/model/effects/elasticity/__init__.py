"""Parts that give way more than the model has, or later."""

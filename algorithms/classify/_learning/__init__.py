"""What classify.train and classify.apply share: features, models, their training and checks."""

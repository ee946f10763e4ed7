"""From the end of a solve to a `FitResult`: error bars, channels beside the model, identifiability and the verdict."""



"""The figures of a study, in the manner of arviz-plots: each returns a PlotCollection.

Neither matplotlib nor arviz_plots is imported until the first figure is drawn.
"""

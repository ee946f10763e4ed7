"""What `thermohyd app` gives to Streamlit, which runs this file for every look at the page."""

from thermohyd.identify.app.page import page


page()

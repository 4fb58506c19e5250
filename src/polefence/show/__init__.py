"""What is shown: figures, pages, the study of the paper."""

# Measures of trials in base R, from their formulas alone: stop-signal reaction time by integration with replacement of
# omissions (Verbruggen et al., 2019), d' and c with the log-linear correction (Hautus, 1995), and a congruency effect of
# means trimmed at three scaled median absolute deviations (Leys et al., 2013). Reads trials.csv, writes measures.csv.
trials <- read.csv("trials.csv")
go <- trials[trials$task == "stop" & trials$correct != "none", ]
stop <- trials[trials$task == "stop" & trials$correct == "none", ]
replaced <- sort(ifelse(is.na(go$response_ms), max(go$response_ms, na.rm = TRUE), go$response_ms))
rate <- mean(!is.na(stop$response_ms))
ssrt <- replaced[ceiling(rate * length(replaced))] - mean(stop$delay_ms)
ssrt_interpolated <- unname(quantile(replaced, rate, type = 6)) - mean(stop$delay_ms)

signal <- trials[trials$task == "detect" & trials$correct != "none", ]
noise <- trials[trials$task == "detect" & trials$correct == "none", ]
z_hit <- qnorm((sum(!is.na(signal$response_ms)) + 0.5) / (nrow(signal) + 1))
z_false_alarm <- qnorm((sum(!is.na(noise$response_ms)) + 0.5) / (nrow(noise) + 1))

stroop <- trials[trials$task == "stroop" & trials$is_correct == "True" & trials$response_ms >= 150, ]
stroop <- stroop[abs(stroop$response_ms - median(stroop$response_ms)) <= 3 * mad(stroop$response_ms, constant = 1.4826), ]
effect <- mean(stroop$response_ms[stroop$congruent == "no"]) - mean(stroop$response_ms[stroop$congruent == "yes"])
write.csv(data.frame(ssrt, ssrt_interpolated, d_prime = z_hit - z_false_alarm, criterion = -(z_hit + z_false_alarm) / 2,
  effect), "measures.csv", row.names = FALSE)
